"""Images as they arrive, and frames that give pixels out of any of them.

`decode` turns a message's bytes into a `Frame`. A frame hands out blue-green-red pixels of a
window, and a copy of the whole picture at a reduced scale; it converts no more than it is asked
for, so that following a target in a YUYV or Bayer stream never touches the full picture.

Reduced pixels are means over blocks that lie on a grid fixed to the picture's upper-left corner,
and a window's pixels do not depend on where the window ends. What the detector computes from a
frame is therefore the same whether it looked at all of it or at a part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .jpeg import JpegHeader, Rounding, read_header

try:
    import simplejpeg
except ImportError:
    simplejpeg = None

Bytes = bytes | bytearray | memoryview | npt.NDArray[np.uint8]
Picture = npt.NDArray[np.uint8]

JPEG_DECODER = 'cv2' if simplejpeg is None else 'simplejpeg'
"""The decoder of this process. The two may differ in the last grey level, so it never changes."""

MAX_PIXELS = 1 << 25
"""Larger pictures are refused before they are decoded: a lying header must not take the memory."""

MIN_SIDE = 8
NOT_ROUNDED = Rounding()
BAYER_MARGIN = 4

_BAYER = {
    'bayer_rggb8': cv2.COLOR_BayerRGGB2BGR,
    'bayer_bggr8': cv2.COLOR_BayerBGGR2BGR,
    'bayer_gbrg8': cv2.COLOR_BayerGBRG2BGR,
    'bayer_grbg8': cv2.COLOR_BayerGRBG2BGR,
}
_YUYV = ('yuv422_yuy2', 'yuyv')
_COLOUR = {'bgr8': 3, 'rgb8': 3, 'bgra8': 4, 'rgba8': 4}
_WITHOUT_COLOUR = ('mono8', 'mono16', '8UC1', '16UC1', '32FC1')

ENCODINGS = (*_COLOUR, *_YUYV, *_BAYER)
"""The raw encodings that `decode` reads, as `sensor_msgs/Image` spells them."""


@dataclass(frozen=True)
class JpegImage:
    """The data of a `sensor_msgs/CompressedImage` of format jpeg."""

    data: Bytes


@dataclass(frozen=True)
class RawImage:
    """The data of a `sensor_msgs/Image`: `step` is the length of a row in bytes."""

    data: Bytes
    width: int
    height: int
    step: int
    encoding: str


def image_of(message: Any) -> JpegImage | RawImage:
    """The picture in a CompressedImage or an Image message, whoever made its class."""
    if not hasattr(message, 'encoding'):
        return JpegImage(message.data)
    return RawImage(message.data, message.width, message.height, message.step, message.encoding)


class Frame(Protocol):
    """A decoded picture. Windows are (x0, y0, x1, y1) in pixels, x1 and y1 excluded."""

    width: int
    height: int
    rounding: Rounding

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        """Give a window's pixels, (y1 - y0, x1 - x0, 3) uint8, blue-green-red."""
        ...

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        """Give a window's means over blocks of factor x factor; its corners lie on the blocks.

        factor is 1 or even. A remainder of less than a block at the right and lower edge of
        the picture is left out.
        """
        ...


class ColourFrame:
    """A picture of interleaved colours: bgr8, rgb8, bgra8 or rgba8."""

    def __init__(
        self, pixels: Picture, encoding: str = 'bgr8', rounding: Rounding = NOT_ROUNDED
    ) -> None:
        self.rounding = rounding
        self.height, self.width = pixels.shape[:2]
        self._pixels = pixels
        self._reverse = encoding.startswith('rgb')

    def _bgr(self, pixels: Picture) -> Picture:
        colours = pixels[..., :3]
        return np.ascontiguousarray(colours[..., ::-1] if self._reverse else colours)

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        return self._bgr(self._pixels[y0:y1, x0:x1])

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        return self._bgr(_block_means(self._pixels[y0:y1, x0:x1], factor, factor))


class YuyvFrame:
    """A YUYV picture, (height, width / 2, 4) uint8: luma, blue, luma, red of each pair of pixels.

    The colour is taken to sit in the middle of its pair, as it does where a camera or a converter
    averages the two pixels.
    """

    def __init__(self, pairs: Picture) -> None:
        self.rounding = NOT_ROUNDED
        self.height, self.width = pairs.shape[0], pairs.shape[1] * 2
        self._pairs = pairs

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        first, last = x0 // 2, (x1 + 1) // 2
        pairs = np.ascontiguousarray(self._pairs[y0:y1, first:last])
        pixels = pairs.reshape(y1 - y0, (last - first) * 2, 2)
        bgr = cv2.cvtColor(pixels, cv2.COLOR_YUV2BGR_YUYV)
        return np.ascontiguousarray(bgr[:, x0 - 2 * first : x1 - 2 * first])

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        if factor == 1:
            return self.window(x0, y0, x1, y1)
        blocks = _block_means(self._pairs[y0:y1, x0 // 2 : x1 // 2], factor // 2, factor)
        luma = cv2.addWeighted(blocks[..., 0], 0.5, blocks[..., 2], 0.5, 0.0)
        pairs = np.ascontiguousarray(np.dstack([luma, blocks[..., 1], luma, blocks[..., 3]]))
        pixels = pairs.reshape(pairs.shape[0], pairs.shape[1] * 2, 2)
        return np.ascontiguousarray(cv2.cvtColor(pixels, cv2.COLOR_YUV2BGR_YUYV)[:, ::2])


class BayerFrame:
    """A colour mosaic of 8 bits; `encoding` names the order of its upper-left cell."""

    def __init__(self, mosaic: Picture, encoding: str) -> None:
        self.rounding = NOT_ROUNDED
        self.height, self.width = mosaic.shape
        self._mosaic = mosaic
        self._code = _BAYER[encoding]
        cell = encoding[len('bayer_') : len('bayer_') + 4]
        self._places = {
            colour: [divmod(k, 2) for k, name in enumerate(cell) if name == colour]
            for colour in 'bgr'
        }

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        # A pixel's colours come from its neighbours, so the window is widened before and cut
        # after; its corner stays on a whole cell, which keeps the mosaic's order.
        left, top = max(x0 - BAYER_MARGIN, 0) // 2 * 2, max(y0 - BAYER_MARGIN, 0) // 2 * 2
        right, bottom = x1 + BAYER_MARGIN, y1 + BAYER_MARGIN
        mosaic = np.ascontiguousarray(self._mosaic[top:bottom, left:right])
        bgr = cv2.cvtColor(mosaic, self._code)
        return np.ascontiguousarray(bgr[y0 - top : y1 - top, x0 - left : x1 - left])

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        if factor == 1:
            return self.window(x0, y0, x1, y1)
        mosaic = self._mosaic[y0 : y0 + (y1 - y0) // 2 * 2, x0 : x0 + (x1 - x0) // 2 * 2]
        means = {
            (row, column): _block_means(mosaic[row::2, column::2], factor // 2, factor // 2)
            for row in (0, 1)
            for column in (0, 1)
        }
        (red,), (blue,) = self._places['r'], self._places['b']
        green = cv2.addWeighted(
            means[self._places['g'][0]], 0.5, means[self._places['g'][1]], 0.5, 0.0
        )
        return np.dstack([means[blue], green, means[red]])


def decode(image: JpegImage | RawImage) -> Frame:
    """Give an image's frame.

    Decoding is apart from detecting, so that a reader of bags can decode in threads: the JPEG
    decoders release the interpreter's lock.

    Raises DetectionError for data that is no such image: empty, truncated, corrupt, of sizes or
    steps that do not hold it, or of an encoding that has no colour or is unknown.
    """
    if isinstance(image, JpegImage):
        pixels, header = _decoded_jpeg(image.data)
        return ColourFrame(pixels, rounding=header.rounding)
    if isinstance(image, RawImage):
        return _decode_raw(image)
    msg = f'image is a {type(image).__name__}: pass a JpegImage or a RawImage'
    raise DetectionError(msg)


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
    return _decoded_jpeg(data)[0]


def _decoded_jpeg(data: Bytes) -> tuple[Picture, JpegHeader]:
    octets = _octets(data)
    header = read_header(octets)
    _check_size(header.width, header.height)
    end = octets[-64:].tobytes().rstrip(b'\x00')
    if not end.endswith(b'\xff\xd9'):
        msg = f'JPEG of {octets.size} bytes has no end marker: it was cut short'
        raise DetectionError(msg)
    decoder = _decode_with_cv2 if simplejpeg is None else _decode_with_simplejpeg
    return decoder(octets), header


def _decode_with_simplejpeg(octets: npt.NDArray[np.uint8]) -> Picture:
    try:
        try:
            return simplejpeg.decode_jpeg(octets, 'BGR')
        except ValueError as error:
            # Cameras pad their scans; the picture is whole all the same.
            if 'extraneous bytes' not in str(error):
                raise
            return simplejpeg.decode_jpeg(octets, 'BGR', strict=False)
    except (ValueError, RuntimeError, MemoryError) as error:
        msg = f'corrupt JPEG of {octets.size} bytes: {str(error).strip() or "undecodable"}'
        raise DetectionError(msg) from error


def _decode_with_cv2(octets: npt.NDArray[np.uint8]) -> Picture:
    try:
        picture = cv2.imdecode(octets, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        msg = f'corrupt JPEG of {octets.size} bytes: {error.err}'
        raise DetectionError(msg) from error
    if picture is None:
        msg = f'corrupt JPEG of {octets.size} bytes: undecodable'
        raise DetectionError(msg)
    return np.asarray(picture, np.uint8)


def _decode_raw(image: RawImage) -> Frame:
    encoding, width, height, step = image.encoding, image.width, image.height, image.step
    if encoding in _WITHOUT_COLOUR:
        msg = f'encoding {encoding} has no colour: the red target needs a colour image'
        raise DetectionError(msg)
    if encoding not in ENCODINGS:
        msg = f'encoding {encoding!r} is unknown: use one of {", ".join(ENCODINGS)}'
        raise DetectionError(msg)
    _check_size(width, height)
    channels = _COLOUR.get(encoding, 2 if encoding in _YUYV else 1)
    if encoding in _YUYV and width % 2:
        msg = f'{encoding} of width {width}: a YUYV row holds pairs of pixels'
        raise DetectionError(msg)
    if step < width * channels:
        msg = f'step {step} is short for {width} pixels of {encoding} ({width * channels} bytes)'
        raise DetectionError(msg)
    octets = _octets(image.data)
    needed = step * (height - 1) + width * channels
    if octets.size < needed:
        msg = (
            f'{octets.size} bytes of data are short for {width} x {height} {encoding}'
            f' of step {step} ({needed} bytes)'
        )
        raise DetectionError(msg)
    rows = np.lib.stride_tricks.as_strided(
        octets, (height, width * channels), (step, 1), writeable=False
    )
    if encoding in _BAYER:
        return BayerFrame(rows, encoding)
    if encoding in _YUYV:
        return YuyvFrame(_split(rows, width // 2, 4))
    return ColourFrame(_split(rows, width, channels), encoding)


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


def _block_means(pixels: Picture, across: int, down: int) -> Picture:
    height, width = pixels.shape[0] // down, pixels.shape[1] // across
    if across == down == 1:
        return pixels
    whole = pixels[: height * down, : width * across]
    # Halving is the one scale at which OpenCV takes means of areas with vector instructions.
    while across % 2 == down % 2 == 0 and (across, down) != (2, 2):
        across, down = across // 2, down // 2
        size = (whole.shape[1] // 2, whole.shape[0] // 2)
        whole = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.uint8)
    means = cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.uint8)
