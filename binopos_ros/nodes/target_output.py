"""What the smoother publishes of the target: its pose in all forms in which it is asked for."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from visualization_msgs.msg import MarkerArray

from binopos_ros.bag.results import pose_covariance
from binopos_ros.nodes import messages
from binopos_ros.nodes.markers import no_markers, target_markers
from binopos_ros.nodes.shell import LOOK_PERIOD, StageNode
from binopos_ros.nodes.transforms import DEPTH, TF, tf_message, transform
from binopos_ros.smoothing.health import LEVELS, Health
from binopos_ros.smoothing.stage import Pose, SmootherOptions


class TargetOutput:
    """Publishes poses and the word on the target's health.

    Args:
        node: gets the publishers.
        options: of the smoother; `configure` changes them.

    Raises:
        ParameterError: `publish_tf` needs a message package that is not installed.
    """

    def __init__(self, node: StageNode, options: SmootherOptions) -> None:
        self._node = node
        self._options = options
        self._pose = node.publisher(PoseWithCovarianceStamped, 'target/pose')
        self._odometry = node.publisher(Odometry, 'target/odometry')
        self._plain = node.publisher(PoseStamped, 'target/pose_stamped')
        self._markers = node.publisher(MarkerArray, 'target/markers')
        self._health = node.publisher(DiagnosticStatus, 'target/health')
        self._tf_message = tf_message('publish_tf') if options.publish_tf else None
        if self._tf_message is not None:
            self._tf = node.create_publisher(self._tf_message, TF, DEPTH)
        self._marked = 0.0
        node.every(LOOK_PERIOD, self._take_markers_away)

    def configure(self, options: SmootherOptions) -> None:
        """Take changed options."""
        self._options = options

    def publish(self, pose: Pose, frame_id: str) -> None:
        """Publish a pose in a frame."""
        state, options = pose.state, self._options
        message = messages.pose_message(
            pose.stamp, frame_id, state.position, state.covariance[:3, :3]
        )
        self._pose.publish(message)
        # A message that nobody hears costs as much as one that somebody does.
        if self._plain.get_subscription_count() > 0:
            self._plain.publish(PoseStamped(header=message.header, pose=message.pose.pose))
        if self._odometry.get_subscription_count() > 0:
            odometry = Odometry(
                header=message.header, child_frame_id=options.child_frame, pose=message.pose
            )
            linear = odometry.twist.twist.linear
            linear.x, linear.y, linear.z = (float(value) for value in state.velocity)
            odometry.twist.covariance = pose_covariance(state.covariance[3:, 3:]).ravel()
            self._odometry.publish(odometry)
        if self._tf_message is not None:
            there = transform(pose.stamp, frame_id, options.child_frame, state.position)
            self._tf.publish(self._tf_message(transforms=[there]))
        if self._markers.get_subscription_count() > 0:
            self._marked = time.monotonic()
            self._markers.publish(
                target_markers(message, options.target_diameter, options.sensor_timeout)
            )

    def tell(self, health: Health, frame_id: str) -> None:
        """Publish the word on the target's health."""
        values = health.values(frame_id)
        self._health.publish(
            DiagnosticStatus(
                level=bytes([LEVELS[health.word]]),
                name=f'{self._node.get_fully_qualified_name().lstrip("/")}: target',
                message=health.word,
                hardware_id='target',
                values=[KeyValue(key=key, value=value) for key, value in values.items()],
            )
        )

    def _take_markers_away(self) -> None:
        """Once the target is lost: no pose has come for so long as one is foretold."""
        if self._marked and time.monotonic() - self._marked > self._options.sensor_timeout:
            self._marked = 0.0
            self._markers.publish(no_markers())
