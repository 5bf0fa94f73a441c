"""What turns a JPEG into pixels: `simplejpeg`, or OpenCV where that is missing.

The two may differ in the last grey level, so a process keeps to the one that it began with.
"""

from __future__ import annotations

import time

import cv2
import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .frames import Picture

try:
    import simplejpeg
except ImportError:
    simplejpeg = None

Octets = npt.NDArray[np.uint8]

JPEG_DECODER = 'cv2' if simplejpeg is None else 'simplejpeg'
"""The decoder of this process."""

REMEDY = '' if simplejpeg is not None else 'pip install simplejpeg: it takes half the time or less'
"""What to do where this decoder is a slow one."""

QUALITY, REPEATS = 90, 3


def decode_whole(octets: Octets) -> Picture:
    """Decode a whole JPEG to (height, width, 3) uint8, blue-green-red.

    Raises DetectionError where the data is corrupt.
    """
    return decode_with_cv2(octets) if simplejpeg is None else _with_simplejpeg(octets)


def decode_with_cv2(octets: Octets, kind: str = 'JPEG') -> Picture:
    """Decode a picture of any kind that OpenCV reads, as `decode_whole` does."""
    try:
        picture = cv2.imdecode(octets, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error as error:
        msg = f'corrupt {kind} of {octets.size} bytes: {error.err}'
        raise DetectionError(msg) from error
    if picture is None:
        msg = f'corrupt {kind} of {octets.size} bytes: undecodable'
        raise DetectionError(msg)
    return np.asarray(picture, np.uint8)


def frame_cost(width: int, height: int) -> float:
    """Seconds that a frame of that size takes here: a JPEG with fine noise, the least of three."""
    patch = np.random.default_rng(0).integers(116, 124, (64, 64, 3), np.uint8)
    picture = np.tile(patch, (-(-height // 64), -(-width // 64), 1))[:height, :width]
    octets = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))[1].ravel()
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        decode_whole(octets)
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
        msg = f'corrupt JPEG of {octets.size} bytes: {str(error).strip() or "undecodable"}'
        raise DetectionError(msg) from error
