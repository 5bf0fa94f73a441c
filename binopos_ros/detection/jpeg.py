"""What a JPEG's header tells: the picture's size, and how coarsely it is rounded."""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .errors import DetectionError

LOW_FREQUENCIES = 6
"""Coefficients, from the lowest frequency on, whose steps tell how coarse a picture is."""

# What an error of luma, and one of each colour difference, does to blue, green and red, as
# covariances (ITU-T T.871).
LUMA_ERROR = np.ones((3, 3))
CHROMA_ERROR = np.outer((1.772, -0.344, 0), (1.772, -0.344, 0))
CHROMA_ERROR += np.outer((0, -0.714, 1.402), (0, -0.714, 1.402))

_WITHOUT_LENGTH = (0x01, *range(0xD0, 0xD8))
_NO_FRAME = (0xC4, 0xC8, 0xCC)
_START_OF_SCAN, _TABLES = 0xDA, 0xDB


class Rounding(NamedTuple):
    """The variance that rounding to a quantisation table's steps leaves, in grey levels^2.

    luma is that of a coefficient of low frequency in brightness. chroma is that of one in a
    colour difference (Cb or Cr), times the number of pixels that share a sample of it. Both are 0
    where each pixel has colours of its own. Of raw pictures whose pixels share their colour they
    are those of whole grey levels.
    """

    luma: float = 0.0
    chroma: float = 0.0


class JpegHeader(NamedTuple):
    """Width and height in pixels, how coarse the picture is, and of how many components."""

    width: int
    height: int
    rounding: Rounding
    components: int


def read_header(octets: npt.NDArray[np.uint8]) -> JpegHeader:
    """Read a JPEG's header.

    Raises DetectionError where no such header is found.
    """
    data = octets.tobytes() if octets.size < 1 << 12 else octets[: 1 << 16].tobytes()
    if not data.startswith(b'\xff\xd8'):
        msg = f'not a JPEG: {octets.size} bytes that begin with {data[:4].hex() or "nothing"}'
        raise DetectionError(msg)
    tables: dict[int, float] = {}
    frame = b''
    place = 2
    while place + 9 <= len(data) and data[place] == 0xFF:
        marker = data[place + 1]
        if marker == 0xFF or marker in _WITHOUT_LENGTH:
            place += 1 if marker == 0xFF else 2
            continue
        end = place + 2 + int.from_bytes(data[place + 2 : place + 4], 'big')
        if marker == _TABLES:
            tables |= _variances(data[place + 4 : end])
        elif 0xC0 <= marker <= 0xCF and marker not in _NO_FRAME:
            frame = data[place + 4 : end]
        elif marker == _START_OF_SCAN:
            break
        place = end
    if len(frame) < 6:
        msg = f'JPEG of {octets.size} bytes has no frame header: it is corrupt'
        raise DetectionError(msg)
    _, height, width = struct.unpack_from('>BHH', frame)
    return JpegHeader(width, height, _rounding(frame[6:], tables), frame[5])


def _variances(segment: bytes) -> dict[int, float]:
    """By table, the mean variance of rounding to the steps of the lowest frequencies."""
    found = {}
    while segment:
        wide, table = bool(segment[0] >> 4), segment[0] & 15
        length = 128 if wide else 64
        if len(segment) <= length:
            break
        steps = np.frombuffer(segment, '>u2' if wide else 'u1', LOW_FREQUENCIES, 1).astype(float)
        found[table] = float(steps @ steps) / (12 * LOW_FREQUENCIES)
        segment = segment[1 + length :]
    return found


def _rounding(components: bytes, tables: dict[int, float]) -> Rounding:
    """Of the first two components: their tables, and how many pixels share a sample."""
    if len(components) < 9:
        return Rounding()
    (_, luma, luma_table), (_, chroma, chroma_table) = components[:3], components[3:6]
    samples = (chroma >> 4) * (chroma & 15)
    area = (luma >> 4) * (luma & 15) / samples if samples else 0.0
    return Rounding(tables.get(luma_table, 0.0), tables.get(chroma_table, 0.0) * area)
