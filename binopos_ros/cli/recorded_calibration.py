"""The camera_info of a bag, as the cameras of its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.messages import STAMP_END
from binopos_ros.bag.reader import BagReader
from binopos_ros.bag.rig_topics import RigTopics
from binopos_ros.optics import CameraInfo, OpticsError
from binopos_ros.optics.camera_info_message import read_camera_info_message


def camera_info_of(message: Any, side: str, *, rectified: bool) -> CameraInfo:
    """The calibration of a camera's pictures, rectified ones or as they were taken.

    Raises:
        OpticsError: it cannot be used.
    """
    info = read_camera_info_message(message, side)
    info = info.of_rectified_pictures() if rectified else info
    info.camera()
    return info


def calibrations(reader: BagReader, topics: RigTopics, side: str) -> Iterator[CameraInfo]:
    """The calibrations of a camera in the bag that can be used, each that differs, in their order.

    Raises:
        BagError: there is none.
        OpticsError: there are only such that cannot be used.
    """
    refusal: OpticsError | BagError | None = None
    body, found = b'', False
    for record in reader.messages(topics.of('camera_info', side)):
        # Cameras repeat it with every image; only the stamp in front differs.
        if record.data[STAMP_END:] == body:
            continue
        body = record.data[STAMP_END:]
        try:
            info = camera_info_of(reader.decode(record), side, rectified=topics.rectified)
        except (OpticsError, BagError) as error:
            refusal = refusal or error
            continue
        found = True
        yield info
    if not found:
        message = f'{reader.path}: {topics.namespace}/{side}/camera_info is empty'
        raise refusal or BagError(message)
