"""Diagnostics of a stage at 1 Hz: what came in, what went out, what was dropped and why."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from binopos_ros.reasons import kind_of

PERIOD = 1.0
WINDOW = 10


class StageDiagnostics:
    """Counts of one stage, published on /diagnostics once per second.

    The level is OK while data flows, WARN in a second in which something was dropped or `fault` is
    set, ERROR while `error` is set, and STALE while nothing comes in.
    """

    def __init__(
        self,
        node: Node,
        hardware_id: str,
        details: Callable[[], Mapping[str, object]] | None = None,
    ) -> None:
        self.received: Counter[str] = Counter()
        self.published = 0
        self.dropped: Counter[str] = Counter()
        self.error = ''
        self._last_drop = ''
        self._node = node
        self._name = f'{node.get_fully_qualified_name().lstrip("/")}: stage'
        self._hardware_id = hardware_id
        self._details = details
        self._past: deque[tuple[float, int, int, int]] = deque(maxlen=WINDOW + 1)
        self._publisher = node.create_publisher(
            DiagnosticArray,
            '/diagnostics',
            QoSProfile(depth=10),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._timer = node.create_timer(PERIOD, self.publish)
        self._remember()

    def drop(self, reason: str, count: int = 1) -> None:
        """Count something that this stage could not use; figures in the reason do not part it."""
        self.dropped[kind_of(reason)] += count
        self._last_drop = reason

    def publish(self) -> None:
        """Publish the counts as they stand."""
        previous = self._past[-1]
        self._remember()
        oldest, now = self._past[0], self._past[-1]
        seconds = max(now[0] - oldest[0], 1e-9)
        values = {
            **{f'Received {topic}': count for topic, count in sorted(self.received.items())},
            'Published': self.published,
            'Dropped': self.dropped.total(),
            **{f'Dropped: {reason}': count for reason, count in sorted(self.dropped.items())},
            **({'Last drop': self._last_drop} if self._last_drop else {}),
            'Input frequency (Hz)': f'{(now[1] - oldest[1]) / seconds:.3f}',
            'Actual frequency (Hz)': f'{(now[2] - oldest[2]) / seconds:.3f}',
            **(self._details() if self._details else {}),
        }
        status = DiagnosticStatus(name=self._name, hardware_id=self._hardware_id)
        status.level, status.message = self._judge(previous, now)
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _judge(
        self, previous: tuple[float, int, int, int], now: tuple[float, int, int, int]
    ) -> tuple[bytes, str]:
        if self.error:
            return DiagnosticStatus.ERROR, self.error
        if now[1] == previous[1]:
            return DiagnosticStatus.STALE, 'no input'
        if now[3] > previous[3]:
            return DiagnosticStatus.WARN, f'{now[3] - previous[3]} dropped: {self._last_drop}'
        return DiagnosticStatus.OK, 'running'

    def _remember(self) -> None:
        seconds = self._node.get_clock().now().nanoseconds * 1e-9
        self._past.append((seconds, self.received.total(), self.published, self.dropped.total()))
