"""JPEGs made for the page: of raw pictures, and thumbnails."""

from __future__ import annotations

from typing import Any

import cv2

from binopos_ros.bag.messages import stamp_of
from binopos_ros.detection.images import decode, decode_jpeg, image_of
from binopos_ros.view.wire import Picture

QUALITY = 85
#: px; pictures of other sizes are made this wide.
THUMBNAIL = 320


def encoded_picture(side: str, message: Any) -> Picture:
    """The picture in a sensor_msgs/Image.

    Raises:
        DetectionError: its encoding is not known, or it is cut short.
    """
    frame = decode(image_of(message))
    return Picture(side, stamp_of(message), _jpeg(frame.window(0, 0, frame.width, frame.height)))


def thumbnail(picture: Picture) -> bytes:
    """A small JPEG of a picture.

    Raises:
        DetectionError: it is damaged.
    """
    pixels = decode_jpeg(picture.jpeg)
    height, width = pixels.shape[:2]
    size = (THUMBNAIL, max(round(height * THUMBNAIL / width), 1))
    return _jpeg(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA))


def _jpeg(pixels: Any) -> bytes:
    _, jpeg = cv2.imencode('.jpg', pixels, (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
    return bytes(jpeg)
