"""Between the rooms' own types and ROS messages."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped
from numpy.typing import ArrayLike, NDArray
from std_msgs.msg import Header

from binopos_ros.bag.results import pose_covariance


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
    message.pose.covariance = pose_covariance(covariance).ravel()
    return message
