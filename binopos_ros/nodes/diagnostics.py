"""Diagnostics of a stage at 1 Hz: what came in, what went out, what was dropped and why."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from binopos_ros.nodes.neighbours import intruders
from binopos_ros.nodes.shell import LOOK_PERIOD, StageNode
from binopos_ros.reasons import count_reason, shown

PERIOD = 1.0
WINDOW = 10


class StageDiagnostics:
    """Counts of one stage, published on /diagnostics once per second of the machine's own time.

    The level is ERROR while one of `errors`, standing problems by what they are about, is set;
    WARN while another node gets in the way; STALE while nothing comes in; WARN in a second in
    which something was dropped, or nothing goes out of what comes in; and OK while data flows.
    """

    def __init__(
        self,
        node: StageNode,
        hardware_id: str,
        details: Callable[[], Mapping[str, object]] | None = None,
    ) -> None:
        self.received: Counter[str] = Counter()
        self.published = 0
        self.dropped: Counter[str] = Counter()
        self.errors: dict[str, str] = {}
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
        self._timers = (
            node.every(PERIOD, self.publish),
            node.every(LOOK_PERIOD, self._look_about),
        )
        self._seen: dict[str, str] = {}
        self._intruders: dict[str, str] = {}
        self._remember()

    def drop(self, reason: str, count: int = 1) -> None:
        """Count something that this stage could not use; figures in the reason do not part it."""
        count_reason(self.dropped, reason, count)
        self._last_drop = shown(reason)

    def judge_input(self, topic: str, problem: str) -> None:
        """Keep what is wrong with a topic's newest message, '' where it is well; log it once."""
        told = f'{topic} {problem}' if problem else ''
        if told and told != self.errors.get(topic):
            self._node.get_logger().error(told)
        self.errors[topic] = told

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
        errors = '; '.join(filter(None, self.errors.values()))
        if errors:
            return DiagnosticStatus.ERROR, errors
        if self._intruders:
            return DiagnosticStatus.WARN, '; '.join(self._intruders.values())
        if now[1] == previous[1]:
            return DiagnosticStatus.STALE, 'no input'
        if now[3] > previous[3]:
            return DiagnosticStatus.WARN, f'{now[3] - previous[3]} dropped: {self._last_drop}'
        if now[2] == previous[2]:
            return DiagnosticStatus.WARN, 'something comes in, and nothing goes out'
        return DiagnosticStatus.OK, 'running'

    def _look_about(self) -> None:
        # Seen twice, as one that has just ended is known for a moment longer.
        seen = intruders(self._node, self._node.sole_topics)
        found = {about: told for about, told in seen.items() if self._seen.get(about) == told}
        news = [told for about, told in found.items() if self._intruders.get(about) != told]
        self._seen, self._intruders = seen, found
        for told in news:
            self._node.get_logger().warning(told)
        if news:
            self.publish()

    def _remember(self) -> None:
        self._past.append(
            (time.monotonic(), self.received.total(), self.published, self.dropped.total())
        )
