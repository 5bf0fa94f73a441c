"""The camera_info of a bag, as the cameras of its pictures."""

from __future__ import annotations

from typing import Any

from binopos_ros.bag.errors import BagError
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


def first_calibration(reader: BagReader, topics: RigTopics, side: str) -> CameraInfo:
    """The first calibration of a camera in the bag that can be used, however late it comes.

    Raises:
        BagError: there is none.
        OpticsError: there are only such that cannot be used.
    """
    refusal: OpticsError | BagError | None = None
    for record in reader.messages(topics.of('camera_info', side)):
        try:
            message = reader.decode(record)
            return camera_info_of(message, side, rectified=topics.rectified)
        except (OpticsError, BagError) as error:
            refusal = refusal or error
    if refusal is None:
        message = f'{reader.path}: {topics.namespace}/{side}/camera_info is empty'
        raise BagError(message)
    raise refusal
