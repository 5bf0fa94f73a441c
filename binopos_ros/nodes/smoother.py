"""The smoother node: `target/position` in, the filtered `target/pose` out."""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.timer import Timer
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from binopos_ros.bag.messages import covariance_of, pose_covariance, position_of, stamp_of
from binopos_ros.nodes import messages
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.markers import no_markers, target_markers
from binopos_ros.nodes.shell import LOOK_PERIOD, StageNode
from binopos_ros.smoothing.parts import PARTS, PartsJoiner, Whole
from binopos_ros.smoothing.stage import LATE, Pose, Smoother, SmootherOptions, filter_options_type


class SmootherNode(StageNode):
    """Smooths positions with a filter and publishes pose, odometry and markers."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('smoother', **node_options)
        self._options = self.declare_options(SmootherOptions, self._configure)
        self._filter_options = self.declare_options(
            filter_options_type(self._options.method), self._configure_filter
        )
        self._frame_id = ''
        self._timer: Timer | None = None
        self._build()
        self._diagnostics = StageDiagnostics(self, 'target', self._details)
        self._certainty = 0.0
        self._pose = self.publisher(PoseWithCovarianceStamped, 'target/pose')
        self._odometry = self.publisher(Odometry, 'target/odometry')
        self._markers = self.publisher(MarkerArray, 'target/markers')
        self._joiner: PartsJoiner[PoseWithCovarianceStamped] = PartsJoiner()
        self._parts = {name: self.resolve_topic_name(f'target/{name}') for name in PARTS}
        for name in PARTS:
            self.subscription(
                PoseWithCovarianceStamped, f'target/{name}', partial(self._on_part, name)
            )
        self.subscription(PoseWithCovarianceStamped, 'target/position', self._on_position)
        self._marked = 0.0
        self.every(LOOK_PERIOD, self._take_markers_away)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def _configure(self, options: SmootherOptions) -> None:
        self._options = options
        self._build()

    def _configure_filter(self, options: Any) -> None:
        self._filter_options = options
        self._build()

    def _build(self) -> None:
        self._smoother = Smoother(self._options, self._filter_options)
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self._options.output_rate > 0:
            self._timer = self.create_timer(1 / self._options.output_rate, self._on_tick)

    def _on_position(self, message: PoseWithCovarianceStamped) -> None:
        self._diagnostics.received['target/position'] += 1
        told = [name for name, topic in self._parts.items() if self.count_publishers(topic)]
        self._take(self._joiner.add_position(stamp_of(message), message, told))

    def _on_part(self, name: str, message: PoseWithCovarianceStamped) -> None:
        part = covariance_of(message)[:3, :3]
        self._take(self._joiner.add_part(name, stamp_of(message), part))

    def _take(self, wholes: Iterable[Whole[PoseWithCovarianceStamped]]) -> None:
        for whole in wholes:
            self._frame_id = whole.position.header.frame_id
            pose, reason = self._smoother.add(
                whole.stamp,
                position_of(whole.position),
                covariance_of(whole.position)[:3, :3],
                **whole.parts,
            )
            if reason:
                self._diagnostics.drop(reason)
            if pose is not None and self._options.output_rate == 0:
                self._publish(pose)
            self._diagnostics.pairs.settle('' if pose is not None else reason or LATE)

    def _on_tick(self) -> None:
        pose = self._smoother.predict(self.get_clock().now().nanoseconds)
        if pose is not None:
            self._publish(pose)

    def _publish(self, pose: Pose) -> None:
        state = pose.state
        self._certainty = state.certainty
        message = messages.pose_message(
            pose.stamp, self._frame_id, state.position, state.covariance[:3, :3]
        )
        self._pose.publish(message)
        odometry = Odometry(header=message.header, child_frame_id='target', pose=message.pose)
        linear = odometry.twist.twist.linear
        linear.x, linear.y, linear.z = (float(value) for value in state.velocity)
        odometry.twist.covariance = pose_covariance(state.covariance[3:, 3:]).ravel()
        self._odometry.publish(odometry)
        if self._markers.get_subscription_count() > 0:
            self._marked = time.monotonic()
            options = self._options
            self._markers.publish(
                target_markers(message, options.target_diameter, options.sensor_timeout)
            )
        self._diagnostics.published += 1

    def _take_markers_away(self) -> None:
        """Once the target is lost: no pose has come for so long as one is foretold."""
        if self._marked and time.monotonic() - self._marked > self._options.sensor_timeout:
            self._marked = 0.0
            self._markers.publish(no_markers())

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._smoother.reset()
        response.success = True
        response.message = 'the target was forgotten'
        return response

    def _details(self) -> dict[str, object]:
        return {'Filter': self._options.method, 'Certainty': f'{self._certainty:.3f}'}
