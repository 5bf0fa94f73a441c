"""The message package of transforms, which every installation from apt has and no wheel."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from binopos_ros.nodes import messages
from binopos_ros.parameters import ParameterError

TF, TF_STATIC = '/tf', '/tf_static'
DEPTH = 100


def tf_message(wanted_by: str) -> Any:
    """The class tf2_msgs/msg/TFMessage.

    Raises:
        ParameterError: it is not installed; `wanted_by` is the parameter that needs it.
    """
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        msg = (
            f'{wanted_by} needs the message package tf2_msgs, which is not installed: install '
            'ros-jazzy-tf2-msgs with apt and source it, or use platform.source: odometry'
        )
        raise ParameterError(msg) from None
    return TFMessage


def latched() -> QoSProfile:
    """The quality of service of /tf_static, for either end."""
    return QoSProfile(depth=DEPTH, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


def transform(
    stamp: int, parent: str, child: str, translation: Any, rotation: Any = (0.0, 0.0, 0.0, 1.0)
) -> TransformStamped:
    """Where a frame is in its parent: ns, m, quaternion x, y, z, w."""
    made = TransformStamped(header=messages.header(stamp, parent), child_frame_id=child)
    place, turn = made.transform.translation, made.transform.rotation
    place.x, place.y, place.z = (float(value) for value in translation)
    turn.x, turn.y, turn.z, turn.w = (float(value) for value in rotation)
    return made
