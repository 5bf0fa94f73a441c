"""The smoother node: `target/position` in, the filtered `target/pose` out."""

from __future__ import annotations

import time
from collections.abc import Iterable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.platform_input import PlatformInput
from binopos_ros.nodes.shell import StageNode
from binopos_ros.nodes.target_output import TargetOutput
from binopos_ros.platform import FixedFrameOptions, Platform, WaitingRoom
from binopos_ros.smoothing.health import HealthMonitor
from binopos_ros.smoothing.parts import PARTS, PartsJoiner, Whole
from binopos_ros.smoothing.stage import LATE, Pose, Smoother, SmootherOptions, filter_options_type

#: Seconds between looks at the target's health, and at what has waited for too long.
LOOK = 0.05


class SmootherNode(StageNode):
    """Smooths positions with a filter, in a fixed frame if it is told to, and publishes them."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('smoother', **node_options)
        self._options = self.declare_options(SmootherOptions, self._configure)
        fixed = self.declare_options(FixedFrameOptions, lambda _: None)
        self._filter_options = self.declare_options(
            filter_options_type(self._options.method), self._configure_filter
        )
        self._frame_id = fixed.fixed_frame
        self._timer: Timer | None = None
        self._ticked = 0
        self._build()
        self._health = HealthMonitor()
        self._platform = Platform(fixed)
        self._waiting: WaitingRoom[Whole[PoseWithCovarianceStamped]] = WaitingRoom(
            self._platform, fixed.platform.timeout
        )
        self._input = PlatformInput(self, self._platform, self._smooth_placed)
        self._diagnostics = StageDiagnostics(self, 'target', self._details)
        self._certainty = 0.0
        self._output = TargetOutput(self, self._options)
        self._joiner: PartsJoiner[PoseWithCovarianceStamped] = PartsJoiner()
        self._parts = {name: self.resolve_topic_name(f'target/{name}') for name in PARTS}
        for name in PARTS:
            self.subscription(
                PoseWithCovarianceStamped, f'target/{name}', partial(self._on_part, name)
            )
        self.subscription(PoseWithCovarianceStamped, 'target/position', self._on_position)
        self.every(LOOK, self._look)
        self.create_service(Trigger, '~/reset', self._on_reset)

    def _configure(self, options: SmootherOptions) -> None:
        self._options = options
        self._output.configure(options)
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
            frame_id = whole.position.header.frame_id
            if self._platform.active:
                self._waiting.add(whole, whole.stamp, frame_id, time.monotonic())
                self._smooth_placed()
                continue
            self._frame_id = frame_id
            point, covariance = _measured(whole)
            self._smooth(whole.stamp, point, covariance, **whole.parts)

    def _smooth_placed(self) -> None:
        """Smooth the positions that need not wait longer for the robot's pose."""
        for whole, rig in self._waiting.ready(time.monotonic()):
            if isinstance(rig, str):
                self._drop(rig)
                self._diagnostics.pairs.settle(rig)
            else:
                self._smooth(whole.stamp, *rig.carry(*_measured(whole), **whole.parts))

    def _smooth(self, stamp: int, *position: Any, **parts: Any) -> None:
        pose, reason = self._smoother.add(stamp, *position, **parts)
        if reason:
            self._drop(reason)
        else:
            self._health.use(time.monotonic())
        if pose is not None and self._options.output_rate == 0:
            self._publish(pose)
        self._diagnostics.pairs.settle('' if pose is not None else reason or LATE)

    def _drop(self, reason: str) -> None:
        self._diagnostics.drop(reason)
        self._health.refuse(reason)

    def _on_tick(self) -> None:
        now = self.get_clock().now().nanoseconds
        if now == self._ticked:
            # /clock has not moved since the last tick: that pose is out.
            return
        self._ticked = now
        pose = self._smoother.predict(now)
        if pose is not None:
            self._publish(pose)

    def _publish(self, pose: Pose) -> None:
        self._certainty = pose.state.certainty
        self._output.publish(pose, self._frame_id)
        self._health.pose(pose.state.covariance[:3, :3])
        self._diagnostics.published += 1
        self._tell()

    def _look(self) -> None:
        self._smooth_placed()
        self._tell()

    def _tell(self) -> None:
        options = self._options
        health = self._health.news(time.monotonic(), options.health, options.sensor_timeout)
        if health is not None:
            self._output.tell(health, self._frame_id)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._smoother.reset()
        self._health.reset()
        response.success = True
        response.message = 'the target was forgotten'
        return response

    def _details(self) -> dict[str, object]:
        return {
            'Filter': self._options.method,
            'Certainty': f'{self._certainty:.3f}',
            **self._input.details(),
        }


def _measured(whole: Whole[PoseWithCovarianceStamped]) -> tuple[Any, Any]:
    """Position (3,), m, and covariance (3, 3), m^2."""
    return position_of(whole.position), covariance_of(whole.position)[:3, :3]
