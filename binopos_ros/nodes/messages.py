"""Between the rooms' own types and ROS messages."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import ArrayLike, NDArray
from sensor_msgs.msg import CameraInfo as CameraInfoMessage
from std_msgs.msg import Header

from binopos_ros.optics.camera_info import CameraInfo, Roi

#: Variance of an angle of which nothing is known: uniform over a turn, rad^2.
UNKNOWN_ANGLE = np.pi**2 / 3


def nanoseconds(stamp: Time) -> int:
    """A ROS stamp in nanoseconds."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def header(stamp: int, frame_id: str) -> Header:
    """A header with a stamp in nanoseconds."""
    seconds, rest = divmod(stamp, 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=rest), frame_id=frame_id)


def pose_message(
    stamp: int, frame_id: str, position: ArrayLike, covariance: NDArray[np.float64]
) -> PoseWithCovarianceStamped:
    """A position (3,) with its (3, 3) or, of the first two axes, (2, 2) covariance.

    The orientation is the identity, with the variance of an unknown angle.
    """
    message = PoseWithCovarianceStamped(header=header(stamp, frame_id))
    point = message.pose.pose.position
    point.x, point.y, point.z = np.asarray(position, dtype=float).tolist()
    message.pose.covariance = pose_covariance(covariance)
    return message


def pose_covariance(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(36,) covariance of a pose from the (k, k) one of its first k coordinates."""
    size = len(covariance)
    full = np.zeros((6, 6))
    full[:size, :size] = covariance
    full[3:, 3:] = UNKNOWN_ANGLE * np.eye(3)
    return full.ravel()


def camera_info(message: CameraInfoMessage, name: str) -> CameraInfo:
    """The calibration in a camera_info message."""
    roi = message.roi
    return CameraInfo(
        name=name,
        width=message.width,
        height=message.height,
        distortion_model=message.distortion_model,
        d=tuple(float(value) for value in message.d),
        k=tuple(float(value) for value in message.k),
        r=tuple(float(value) for value in message.r),
        p=tuple(float(value) for value in message.p),
        binning=(message.binning_x, message.binning_y),
        roi=Roi(roi.x_offset, roi.y_offset, roi.height, roi.width, roi.do_rectify),
    )
