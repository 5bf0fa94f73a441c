"""Calibrations into and out of sensor_msgs/CameraInfo messages, whoever made their class."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np

from binopos_ros.optics.camera_info import CameraInfo, Roi, lens_model


def read_camera_info_message(message: Any, name: str) -> CameraInfo:
    """The calibration in a CameraInfo message, of the camera of that name."""
    return CameraInfo(
        name=name,
        width=int(message.width),
        height=int(message.height),
        distortion_model=lens_model(str(message.distortion_model), len(message.d)),
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


def camera_info_fields(info: CameraInfo, region_of_interest: Callable[..., Any]) -> dict[str, Any]:
    """The fields of a CameraInfo message but for its header; the camera's name is not of them.

    `region_of_interest` is the class of sensor_msgs/RegionOfInterest that goes with the message's.
    """
    return {
        'width': info.width,
        'height': info.height,
        'distortion_model': info.distortion_model,
        'd': np.array(info.d, dtype=np.float64),
        'k': np.array(info.k, dtype=np.float64),
        'r': np.array(info.r, dtype=np.float64),
        'p': np.array(info.p, dtype=np.float64),
        'binning_x': info.binning[0],
        'binning_y': info.binning[1],
        'roi': region_of_interest(**asdict(info.roi)),
    }
