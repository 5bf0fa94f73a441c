"""The message package of transforms, which every installation from apt has and no wheel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile

from binopos_ros.nodes import messages
from binopos_ros.optics import CameraInfo, stereo_from_camera_infos
from binopos_ros.parameters import ParameterError
from binopos_ros.platform.quaternions import quaternion_of

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


class RightUnderLeft:
    """Tells where the right camera's frame is in the left one's, all who come.

    Args:
        node: gets the publisher.
        frames: of the left and the right camera.

    Raises:
        ParameterError: the message package is missing.
    """

    def __init__(self, node: Node, frames: tuple[str, str]) -> None:
        self._message = tf_message('publish_tf')
        self._node, self._frames = node, frames
        self._publisher = node.create_publisher(self._message, TF_STATIC, latched())

    def publish(self, calibrations: Mapping[str, CameraInfo]) -> None:
        """Send it as it follows from the calibrations by side, in place of what was sent before.

        Raises:
            ParameterError: a calibration is missing.
            OpticsError: the calibrations make no rig.
        """
        if len(calibrations) < 2:
            msg = 'publish_tf needs left.camera_info_url and right.camera_info_url: set both'
            raise ParameterError(msg)
        _, _, rotation, translation = stereo_from_camera_infos(
            calibrations['left'], calibrations['right']
        )
        place = -rotation.T @ translation
        stamp = self._node.get_clock().now().nanoseconds
        made = transform(stamp, *self._frames, place, quaternion_of(rotation.T))
        self._publisher.publish(self._message(transforms=[made]))
