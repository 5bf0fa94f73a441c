"""What the driver's pixel formats are called in ROS, and how a row of them splits in two."""

from __future__ import annotations

import array

import numpy as np
from numpy.typing import NDArray

from binopos_ros.capture.errors import CaptureError

JPEG_FORMATS = ('MJPG', 'JPEG')

ENCODINGS = {
    'YUYV': ('yuv422_yuy2', 2),
    'UYVY': ('yuv422', 2),
    'RGB3': ('rgb8', 3),
    'BGR3': ('bgr8', 3),
    'RGGB': ('bayer_rggb8', 1),
    'BA81': ('bayer_bggr8', 1),
    'GBRG': ('bayer_gbrg8', 1),
    'GRBG': ('bayer_grbg8', 1),
    'GREY': ('mono8', 1),
}
"""V4L2's four letters -> the encoding of sensor_msgs/Image and its bytes per pixel."""


def known_format(pixel_format: str) -> str:
    """Give the format back where the suite can pass it on.

    :raises CaptureError: where it cannot.
    """
    if pixel_format not in (*JPEG_FORMATS, *ENCODINGS):
        known = ', '.join((*JPEG_FORMATS, *ENCODINGS))
        message = f'pixel_format {pixel_format!r} cannot be passed on; choose one of {known}'
        raise CaptureError(message)
    return pixel_format


def jpeg_fault(data: memoryview) -> str:
    """Why the bytes cannot be a whole JPEG; '' where they may be. Damage inside is not seen.

    Cameras pad their images with zeros, so the end marker need not be at the end.
    """
    if data[:2] != b'\xff\xd8':
        return 'not a JPEG'
    end = len(data)
    while end > 2:
        chunk = bytes(data[max(0, end - 4096) : end]).rstrip(b'\0')
        if chunk:
            start = max(0, end - 4096)
            tail = bytes(data[max(0, start + len(chunk) - 2) : start + len(chunk)])
            return '' if tail == b'\xff\xd9' else 'JPEG cut short'
        end -= 4096
    return 'JPEG cut short'


def raw_fault(data: memoryview, step: int, height: int) -> str:
    """Why the bytes cannot be a whole raw image; '' where they are."""
    return 'image cut short' if len(data) < step * height else ''


def packed(half: NDArray[np.uint8]) -> array.array[int]:
    """Copy a picture, or half of one, once, into what a ROS message takes as its data."""
    payload = array.array('B', [0]) * half.size
    np.frombuffer(payload, np.uint8).reshape(half.shape)[...] = half
    return payload


def split_raw(
    data: memoryview, step: int, height: int, width: int, pixel: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Split a raw side-by-side image.

    :param step: bytes per line, padding at its end included.
    :param width: of both views together, px; `pixel`: bytes per pixel.
    :returns: left and right as (height, width / 2 * pixel) views of the bytes.
    """
    lines = np.frombuffer(data, np.uint8, step * height).reshape(height, step)
    return split_side_by_side(lines[:, : width * pixel])


def split_side_by_side(picture: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Split a picture that holds the left view beside the right one.

    :param picture: (height, 2 width, ...).
    :returns: the two halves, (height, width, ...), as views.
    :raises CaptureError: where the width is odd.
    """
    width = picture.shape[1]
    if width % 2:
        message = (
            f'a side-by-side image of odd width {width} px cannot be split; choose another size'
        )
        raise CaptureError(message)
    return picture[:, : width // 2], picture[:, width // 2 :]
