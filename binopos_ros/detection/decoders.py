"""What turns a JPEG into pixels: the compiled part, `simplejpeg`, or OpenCV, the first there is.

They may differ in the last grey level, so a process keeps to the one that it began with. The
compiled part (`_partial.c`) is built where a compiler and the headers of libjpeg-turbo are; it
alone decodes parts of a picture.
"""

from __future__ import annotations

import time

import cv2
import numpy as np
import numpy.typing as npt

from .errors import UnreadableError
from .frames import Picture

try:
    import simplejpeg
except ImportError:
    simplejpeg = None

try:
    from ._partial import decode_part
except ImportError:
    decode_part = None  # type: ignore[assignment]

Octets = npt.NDArray[np.uint8]

DECODERS = {'libjpeg-turbo': decode_part, 'simplejpeg': simplejpeg, 'cv2': cv2}
JPEG_DECODER = next(name for name, means in DECODERS.items() if means is not None)
"""The decoder of this process."""

REMEDY = '' if JPEG_DECODER != 'cv2' else 'pip install simplejpeg: it takes half the time or less'
"""What to do where this decoder is a slow one."""

QUALITY, REPEATS = 90, 3


def decode_whole(octets: Octets, size: tuple[int, int]) -> Picture:
    """Decode a whole JPEG of a size (width, height) to (height, width, 3) uint8, blue-green-red.

    Raises UnreadableError where the data is corrupt.
    """
    if JPEG_DECODER == 'libjpeg-turbo':
        return decode_box(octets, size, (0, 0, *size))
    return decode_with_cv2(octets) if JPEG_DECODER == 'cv2' else _with_simplejpeg(octets)


def decode_box(octets: Octets, size: tuple[int, int], box: tuple[int, int, int, int]) -> Picture:
    """Decode a box (x0, y0, x1, y1) of a JPEG of a size (width, height), as `decode_whole` does.

    Only where `decodes_parts`. Raises UnreadableError where the data down to there is corrupt.
    """
    x0, y0, x1, y1 = box
    pixels = np.empty((y1 - y0, x1 - x0, 3), np.uint8)
    try:
        decode_part(octets, pixels, size, box)
    except ValueError as error:
        raise _corrupt(octets, 'JPEG', str(error)) from error
    return pixels


def decodes_parts() -> bool:
    """Whether the decoder of this process can decode a part of a picture."""
    return JPEG_DECODER == 'libjpeg-turbo'


def decode_with_cv2(octets: Octets, kind: str = 'JPEG') -> Picture:
    """Decode a picture of any kind that OpenCV reads, as `decode_whole` does."""
    try:
        picture = cv2.imdecode(octets, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        raise _corrupt(octets, kind, error.err) from error
    if picture is None:
        raise _corrupt(octets, kind, '')
    return np.asarray(picture, np.uint8)


def frame_cost(width: int, height: int) -> float:
    """Seconds that a frame of that size takes here: a JPEG with fine noise, the least of three."""
    patch = np.random.default_rng(0).integers(116, 124, (64, 64, 3), np.uint8)
    picture = np.tile(patch, (-(-height // 64), -(-width // 64), 1))[:height, :width]
    octets = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].ravel()
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        decode_whole(octets, (width, height))
        times.append(time.perf_counter() - begin)
    return min(times)


def told(width: int, height: int) -> str:
    """Which decoder this is and what a frame of that size costs, for people."""
    cost = 1e3 * frame_cost(width, height)
    return f'{JPEG_DECODER}, {cost:.1f} ms for a frame of {width} x {height}'


def _with_simplejpeg(octets: Octets) -> Picture:
    try:
        try:
            return simplejpeg.decode_jpeg(octets, 'BGR')
        except ValueError as error:
            # Cameras pad their scans; the picture is whole all the same.
            if 'extraneous bytes' not in str(error):
                raise
            return simplejpeg.decode_jpeg(octets, 'BGR', strict=False)
    except (ValueError, RuntimeError, MemoryError) as error:
        raise _corrupt(octets, 'JPEG', str(error)) from error


def _corrupt(octets: Octets, kind: str, why: str) -> UnreadableError:
    return UnreadableError(
        f'corrupt {kind} of {octets.size} bytes: {why.strip() or "undecodable"}'
    )
