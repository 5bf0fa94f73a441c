"""The target as RViz shows it: a red ball, and the 95 % ellipsoid of its position."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.duration import Duration
from visualization_msgs.msg import Marker, MarkerArray

from binopos_ros.platform.quaternions import quaternion_of

#: Of the chi-square distribution with three degrees of freedom, the 95 % point.
CHI_SQUARE_95 = 7.815
#: Of the ball where the target's is not known, m.
DIAMETER = 0.02


def target_markers(
    pose: PoseWithCovarianceStamped, diameter: float, lifetime: float
) -> MarkerArray:
    """The ball at the target's position and the ellipsoid about it, each seen through the other.

    Args:
        pose: of the target.
        diameter: of the target, m; 0 where it is not known.
        lifetime: seconds after which they vanish, unless they are renewed.
    """
    ball = Marker(header=pose.header, ns='target', id=0, type=Marker.SPHERE, action=Marker.ADD)
    ball.pose = pose.pose.pose
    ball.scale.x = ball.scale.y = ball.scale.z = diameter or DIAMETER
    ball.color.r, ball.color.a = 1.0, 0.4
    ellipsoid = Marker(
        header=pose.header, ns='covariance', id=1, type=Marker.SPHERE, action=Marker.ADD
    )
    ball.lifetime = ellipsoid.lifetime = Duration(seconds=lifetime).to_msg()
    ellipsoid.pose.position = pose.pose.pose.position
    covariance = np.asarray(pose.pose.covariance).reshape(6, 6)[:3, :3]
    variances, axes = np.linalg.eigh(covariance)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    orientation = ellipsoid.pose.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion_of(axes)
    lengths = 2 * np.sqrt(CHI_SQUARE_95 * np.clip(variances, 1e-12, None))
    ellipsoid.scale.x, ellipsoid.scale.y, ellipsoid.scale.z = (float(x) for x in lengths)
    ellipsoid.color.r, ellipsoid.color.g, ellipsoid.color.a = 1.0, 0.6, 0.7
    return MarkerArray(markers=[ball, ellipsoid])


def no_markers() -> MarkerArray:
    """What takes the target's markers away."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])
