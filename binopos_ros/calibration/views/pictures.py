"""A pair of pictures that has not been read yet, and how pictures become grey values.

A picture is taken as its sensor wrote it: EXIF may say that it wants to be turned, but the nodes
see the pixels as they are, so a calibration must, too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.detection.images import JpegImage, RawImage, decode

MONO = ('mono8', '8UC1')
DEEP_MONO = ('mono16', '16UC1')
AS_STORED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION

Load = Callable[[], np.ndarray]


@dataclass(frozen=True)
class PicturePair:
    """A pair of pictures, loaded when called: (H, W) uint8; CalibrationError where one cannot."""

    name: str
    left: Load
    right: Load


@dataclass(frozen=True)
class Pictures:
    """pairs: in order; unmatched: pictures without a partner, with the reason."""

    pairs: tuple[PicturePair, ...]
    unmatched: tuple[Dropped, ...] = ()


def read_picture(path: Path) -> np.ndarray:
    """(H, W) uint8 of a file.

    Raises:
        CalibrationError: it is missing, or no picture.
    """
    # Read here: OpenCV prints of its own what it cannot open.
    try:
        octets = np.fromfile(path, np.uint8)
    except OSError:
        octets = np.empty(0, np.uint8)
    return decoded(octets, str(path))


def decoded(octets: np.ndarray, name: str) -> np.ndarray:
    """(H, W) uint8 of a file's bytes.

    Raises:
        CalibrationError: they are no picture.
    """
    image = cv2.imdecode(octets, AS_STORED) if octets.size else None
    if image is None:
        raise CalibrationError(f'{name} is missing or no picture that can be read')
    return np.asarray(image)


def grey_picture(image: JpegImage | RawImage, stamp: int) -> np.ndarray:
    """(H, W) uint8 of a camera's image, of that stamp (ns).

    Raises:
        CalibrationError: the picture is damaged.
    """
    if isinstance(image, JpegImage):
        data = np.frombuffer(image.data, np.uint8)
        grey = cv2.imdecode(data, AS_STORED) if data.size else None
        if grey is None:
            raise CalibrationError(f'the picture at {stamp / 1e9:.3f} is damaged: leave it out')
        return np.asarray(grey)
    if image.encoding in (*MONO, *DEEP_MONO):
        rows = np.frombuffer(image.data, np.uint8)
        if rows.size < image.height * image.step:
            raise CalibrationError(f'the picture at {stamp / 1e9:.3f} is cut short: leave it out')
        rows = rows[: image.height * image.step].reshape(image.height, image.step)
        if image.encoding in DEEP_MONO:
            return _eight_bits(
                rows[:, : 2 * image.width].copy().view('>u2' if image.big_endian else '<u2')
            )
        return np.ascontiguousarray(rows[:, : image.width])
    frame = decode(image)
    return cv2.cvtColor(frame.window(0, 0, frame.width, frame.height), cv2.COLOR_BGR2GRAY)


def _eight_bits(deep: np.ndarray) -> np.ndarray:
    """The upper eight of the bits that are used: cameras put 10 or 12 of them into 16."""
    used = int(deep.max(initial=0)).bit_length()
    return (deep >> max(used - 8, 0)).astype(np.uint8)
