"""Calibrations out of sensor_msgs/CameraInfo messages, whoever made their class."""

from __future__ import annotations

from typing import Any

from binopos_ros.optics.camera_info import CameraInfo, Roi


def read_camera_info_message(message: Any, name: str) -> CameraInfo:
    """The calibration in a CameraInfo message, of the camera of that name."""
    return CameraInfo(
        name=name,
        width=int(message.width),
        height=int(message.height),
        distortion_model=str(message.distortion_model),
        d=tuple(map(float, message.d)),
        k=tuple(map(float, message.k)),
        r=tuple(map(float, message.r)),
        p=tuple(map(float, message.p)),
        binning=(int(message.binning_x), int(message.binning_y)),
        roi=Roi(
            x_offset=int(message.roi.x_offset),
            y_offset=int(message.roi.y_offset),
            height=int(message.roi.height),
            width=int(message.roi.width),
            do_rectify=bool(message.roi.do_rectify),
        ),
    )
