"""Images as they arrive, and frames that give pixels out of any of them.

`decode` turns a message's bytes into a `Frame`. A frame hands out blue-green-red pixels of a
window, and a copy of the whole picture at a reduced scale; it converts no more than it is asked
for, so that following a target in a YUYV or Bayer stream never touches the full picture.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .decoders import decode_whole, decode_with_cv2, decodes_parts
from .errors import DetectionError
from .frames import SHARED_BY_FOUR, BayerFrame, ColourFrame, Frame, Picture, YuyvFrame
from .jpeg import JpegHeader, read_header
from .jpeg_frame import Box, JpegFrame

__all__ = [
    'ENCODINGS',
    'ColourFrame',
    'Frame',
    'JpegImage',
    'Picture',
    'RawImage',
    'decode',
    'decode_jpeg',
    'halves',
    'image_of',
    'prepare',
]

Bytes = bytes | bytearray | memoryview | npt.NDArray[np.uint8]

MAX_PIXELS = 1 << 25
"""Larger pictures are refused before they are decoded: a lying header must not take the memory."""

MIN_SIDE = 8

_PNG = b'\x89PNG\r\n\x1a\n'
_PNG_HEADER = struct.Struct('>II2B')
_PNG_GREY = (0, 4)
BAYER_CELLS = ('rggb', 'bggr', 'gbrg', 'grbg')
_WITHOUT_COLOUR = ('mono8', 'mono16', '8UC1', '16UC1', '32FC1')


@dataclass(frozen=True)
class JpegImage:
    """The data of a `sensor_msgs/CompressedImage`, of format jpeg or png."""

    data: Bytes


@dataclass(frozen=True)
class RawImage:
    """The data of a `sensor_msgs/Image`: `step` is the length of a row in bytes."""

    data: Bytes
    width: int
    height: int
    step: int
    encoding: str
    big_endian: bool = False


class _Encoding(NamedTuple):
    """How the rows of an encoding become a frame.

    `frame` takes rows of bytes, (height, bytes of the pixels in a row), and the image. Where the
    colours lie below the brightness in a plane of their own, there are half as many rows again.
    """

    pixel_bytes: int
    frame: Callable[[Picture, RawImage], Frame]
    even_width: bool = False
    colour_plane: bool = False


def image_of(message: Any) -> JpegImage | RawImage:
    """The picture in a CompressedImage or an Image message, whoever made its class."""
    if not hasattr(message, 'encoding'):
        return JpegImage(message.data)
    return RawImage(
        message.data,
        message.width,
        message.height,
        message.step,
        message.encoding,
        bool(message.is_bigendian),
    )


def decode(image: JpegImage | RawImage) -> Frame:
    """Give an image's frame.

    Decoding is apart from detecting, so that a reader of bags can decode in threads: the JPEG
    decoders release the interpreter's lock.

    Raises DetectionError for data that is no such image: empty, truncated, corrupt, of sizes or
    steps that do not hold it, or of an encoding that has no colour or is unknown.
    """
    if isinstance(image, JpegImage):
        octets = _octets(image.data)
        if octets[: len(_PNG)].tobytes() == _PNG:
            return _decode_png(octets)
        header = _colour_header(octets)
        pixels = decode_whole(octets, (header.width, header.height))
        return ColourFrame(pixels, rounding=header.rounding)
    if isinstance(image, RawImage):
        return _decode_raw(image)
    msg = f'image is a {type(image).__name__}: pass a JpegImage or a RawImage'
    raise DetectionError(msg)


def prepare(image: JpegImage | RawImage, box: Box | None) -> Frame:
    """Give an image's frame as `decode` does, of a JPEG with no more than a box decoded so far.

    The rest will be when it is looked at; box is (x0, y0, x1, y1), None the whole. Where the
    decoder of this process cannot decode parts it is the same as `decode`.
    """
    if not isinstance(image, JpegImage) or not decodes_parts():
        return decode(image)
    octets = _octets(image.data)
    if octets[: len(_PNG)].tobytes() == _PNG:
        return _decode_png(octets)
    frame = JpegFrame(octets, _colour_header(octets))
    frame.foresee(box)
    return frame


def halves(frame: Frame) -> tuple[Frame, Frame]:
    """Give the left and the right half of a side-by-side picture, a frame each.

    Raises DetectionError where the width is odd.
    """
    if frame.width % 2:
        msg = f'side-by-side picture of width {frame.width}: its halves differ'
        raise DetectionError(msg)
    half = frame.width // 2
    left, right = (
        ColourFrame(frame.window(x, 0, x + half, frame.height), rounding=frame.rounding)
        for x in (0, half)
    )
    return left, right


def decode_jpeg(data: Bytes) -> Picture:
    """Decode a whole JPEG to (height, width, 3) uint8, blue-green-red.

    Raises DetectionError where the data is no JPEG, ends early, is corrupt, or is too large.
    """
    octets = _octets(data)
    header = _header(octets)
    return decode_whole(octets, (header.width, header.height))


def _colour_header(octets: npt.NDArray[np.uint8]) -> JpegHeader:
    header = _header(octets)
    if header.components == 1:
        raise DetectionError(_no_colour('JPEG'))
    return header


def _header(octets: npt.NDArray[np.uint8]) -> JpegHeader:
    """The header of a JPEG that is not too large and has an end."""
    header = read_header(octets)
    _check_size(header.width, header.height)
    end = octets[-64:].tobytes().rstrip(b'\x00')
    if not end.endswith(b'\xff\xd9'):
        msg = f'JPEG of {octets.size} bytes has no end marker: it was cut short'
        raise DetectionError(msg)
    return header


def _decode_png(octets: npt.NDArray[np.uint8]) -> Frame:
    header = octets[16:26].tobytes()
    if len(header) < _PNG_HEADER.size:
        msg = f'PNG of {octets.size} bytes has no header: it was cut short'
        raise DetectionError(msg)
    width, height, _, colours = _PNG_HEADER.unpack(header)
    _check_size(width, height)
    if colours in _PNG_GREY:
        raise DetectionError(_no_colour('PNG'))
    return ColourFrame(decode_with_cv2(octets, 'PNG'))


def _decode_raw(image: RawImage) -> Frame:
    encoding, width, height, step = image.encoding, image.width, image.height, image.step
    if encoding in _WITHOUT_COLOUR:
        raise DetectionError(_no_colour(f'encoding {encoding}'))
    known = _ENCODINGS.get(encoding)
    if known is None:
        msg = f'encoding {encoding!r} is unknown: use one of {", ".join(ENCODINGS)}'
        raise DetectionError(msg)
    _check_size(width, height)
    if known.even_width and width % 2:
        msg = f'{encoding} of width {width}: its rows hold pairs of pixels'
        raise DetectionError(msg)
    if known.colour_plane and height % 2:
        msg = f'{encoding} of height {height}: its colours are of pairs of rows'
        raise DetectionError(msg)
    row = width * known.pixel_bytes
    if step < row:
        msg = f'step {step} is short for {width} pixels of {encoding} ({row} bytes)'
        raise DetectionError(msg)
    octets = _octets(image.data)
    rows = height * 3 // 2 if known.colour_plane else height
    needed = step * (rows - 1) + row
    if octets.size < needed:
        msg = (
            f'{octets.size} bytes of data are short for {width} x {height} {encoding}'
            f' of step {step} ({needed} bytes)'
        )
        raise DetectionError(msg)
    return known.frame(
        np.lib.stride_tricks.as_strided(octets, (rows, row), (step, 1), writeable=False), image
    )


def _no_colour(what: str) -> str:
    return f'{what} has no colour: the red target needs a colour image'


def _colour(channels: int, order: str) -> _Encoding:
    return _Encoding(
        channels, lambda rows, image: ColourFrame(_split(rows, image.width, channels), order)
    )


def _deep_colour(channels: int, order: str) -> _Encoding:
    return _Encoding(
        2 * channels,
        lambda rows, image: ColourFrame(
            _split(_high_bytes(rows, image), image.width, channels), order
        ),
    )


def _bayer(order: str) -> _Encoding:
    return _Encoding(1, lambda rows, _: BayerFrame(rows, order))


def _deep_bayer(order: str) -> _Encoding:
    return _Encoding(2, lambda rows, image: BayerFrame(_high_bytes(rows, image), order))


def _high_bytes(rows: Picture, image: RawImage) -> Picture:
    """Of values of 16 bits the upper 8, which is what the detector's levels are of."""
    return np.ascontiguousarray(rows[:, 0 if image.big_endian else 1 :: 2])


def _yuyv(rows: Picture, image: RawImage) -> Frame:
    return YuyvFrame(_split(rows, image.width // 2, 4))


def _uyvy(rows: Picture, image: RawImage) -> Frame:
    swapped = np.empty_like(rows)
    swapped[:, ::2], swapped[:, 1::2] = rows[:, 1::2], rows[:, ::2]
    return _yuyv(swapped, image)


def _planes(code: int) -> _Encoding:
    return _Encoding(
        1,
        lambda rows, _: ColourFrame(
            np.asarray(cv2.cvtColor(np.ascontiguousarray(rows), code), np.uint8),
            rounding=SHARED_BY_FOUR,
        ),
        even_width=True,
        colour_plane=True,
    )


def _split(rows: Picture, width: int, channels: int) -> Picture:
    step = rows.strides[0]
    return np.lib.stride_tricks.as_strided(
        rows, (rows.shape[0], width, channels), (step, channels, 1), writeable=False
    )


def _check_size(width: int, height: int) -> None:
    if not (width >= MIN_SIDE and height >= MIN_SIDE and width * height <= MAX_PIXELS):
        msg = f'image of {width} x {height} pixels: {MIN_SIDE} per side to {MAX_PIXELS} in all'
        raise DetectionError(msg)


def _octets(data: Bytes) -> npt.NDArray[np.uint8]:
    try:
        octets = np.frombuffer(data, np.uint8)
    except (TypeError, ValueError, BufferError) as error:
        msg = f'image data is no run of bytes: {error}'
        raise DetectionError(msg) from error
    if not octets.size:
        msg = 'image has no data'
        raise DetectionError(msg)
    return octets


_ENCODINGS = {
    **dict.fromkeys(('bgr8', '8UC3'), _colour(3, 'bgr8')),
    'rgb8': _colour(3, 'rgb8'),
    **dict.fromkeys(('bgra8', '8UC4'), _colour(4, 'bgra8')),
    'rgba8': _colour(4, 'rgba8'),
    **dict.fromkeys(('bgr16', '16UC3'), _deep_colour(3, 'bgr8')),
    'rgb16': _deep_colour(3, 'rgb8'),
    **dict.fromkeys(('bgra16', '16UC4'), _deep_colour(4, 'bgra8')),
    'rgba16': _deep_colour(4, 'rgba8'),
    **dict.fromkeys(('yuv422_yuy2', 'yuyv'), _Encoding(2, _yuyv, even_width=True)),
    **dict.fromkeys(('yuv422', 'uyvy'), _Encoding(2, _uyvy, even_width=True)),
    'nv12': _planes(cv2.COLOR_YUV2BGR_NV12),
    'nv21': _planes(cv2.COLOR_YUV2BGR_NV21),
    **{f'bayer_{cell}8': _bayer(f'bayer_{cell}8') for cell in BAYER_CELLS},
    **{f'bayer_{cell}16': _deep_bayer(f'bayer_{cell}8') for cell in BAYER_CELLS},
}

ENCODINGS = tuple(_ENCODINGS)
"""The raw encodings that `decode` reads, as `sensor_msgs/Image` spells them."""
