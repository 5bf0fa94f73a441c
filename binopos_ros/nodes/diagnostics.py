"""Diagnostics of a stage at 1 Hz: what came in, what went out, what was dropped and why."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions

from binopos_ros.nodes.neighbours import Neighbours
from binopos_ros.nodes.shell import LOOK_PERIOD, StageNode
from binopos_ros.reasons import Ledger, count_reason, shown

DIAGNOSTICS = '/diagnostics'
PERIOD = 1.0
WINDOW = 10
#: Keys of what became of pairs; the reasons of those that are lost come behind 'Pairs: '.
PAIRS, PAIRS_USED = 'Pairs', 'Pairs used'
#: Before the full name of a topic that the node publishes: how many subscriptions it reaches.
REACHED = 'Subscribers of '


class StageDiagnostics:
    """Counts of one stage, published on /diagnostics once per second of the machine's own time.

    The level is ERROR while one of `errors`, standing problems by what they are about, is set;
    WARN while another node gets in the way or a sender's clock differs; STALE while nothing comes
    in; WARN in a second in which something was dropped or lost on its way here, or nothing goes
    out of what comes in, and while a caution stands; OK while data flows, and while a node says
    why it is `idle`. What is dropped may be told from any thread.
    """

    def __init__(
        self,
        node: StageNode,
        hardware_id: str,
        details: Callable[[], Mapping[str, object]] | None = None,
        pairs: Ledger | None = None,
    ) -> None:
        self.pairs = pairs or Ledger()
        self.received: Counter[str] = Counter()
        self.published = 0
        self.dropped: Counter[str] = Counter()
        self.errors: dict[str, str] = {}
        self.idle = ''
        self._cautions: dict[str, str] = {}
        self._last_drop = ''
        self._lock = threading.Lock()
        self._node = node
        self._name = f'{node.get_fully_qualified_name().lstrip("/")}: stage'
        self._hardware_id = hardware_id
        self._details = details
        self._past: deque[_Counts] = deque(maxlen=WINDOW + 1)
        self._publisher = node.create_publisher(
            DiagnosticArray,
            DIAGNOSTICS,
            QoSProfile(depth=10),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._timers = (
            node.every(PERIOD, self.publish),
            node.every(LOOK_PERIOD, self._look_about),
        )
        self._neighbours = Neighbours(node, DIAGNOSTICS)
        self._seen: dict[str, str] = {}
        self._intruders: dict[str, str] = {}
        self._odd_clocks: dict[str, str] = {}
        self._clocks: dict[str, str] = {}
        self._remember()

    def drop(self, reason: str, count: int = 1) -> None:
        """Count something that this stage could not use; figures in the reason do not part it."""
        with self._lock:
            count_reason(self.dropped, reason, count)
            self._last_drop = shown(reason)

    def judge_input(self, topic: str, problem: str) -> None:
        """Keep what is wrong with a topic's newest message, '' where it is well; log it once."""
        told = f'{topic} {problem}' if problem else ''
        if told and told != self.errors.get(topic):
            self._node.get_logger().error(told)
        self.errors[topic] = told

    def caution(self, about: str, told: str) -> None:
        """Keep what makes the results worse than they look, '' for nothing; log it once."""
        if told and told != self._cautions.get(about):
            self._node.get_logger().warning(told)
        self._cautions[about] = told

    def publish(self) -> None:
        """Publish the counts as they stand."""
        previous = self._past[-1]
        self._remember()
        self._look_at_clocks()
        oldest, now = self._past[0], self._past[-1]
        seconds = max(now.time - oldest.time, 1e-9)
        with self._lock:
            dropped, last_drop = self.dropped.copy(), self._last_drop
        values = {
            **{f'Received {topic}': count for topic, count in sorted(self.received.items())},
            'Published': self.published,
            'Dropped': dropped.total(),
            **{f'Dropped: {reason}': count for reason, count in sorted(dropped.items())},
            **({'Last drop': last_drop} if last_drop else {}),
            **{f'Lost {topic}': count for topic, count in sorted(self._node.lost.items())},
            **self._pair_values(),
            **{f'{REACHED}{topic}': count for topic, count in self._node.reached().items()},
            'Input frequency (Hz)': f'{(now.received - oldest.received) / seconds:.3f}',
            'Actual frequency (Hz)': f'{(now.published - oldest.published) / seconds:.3f}',
            **(self._details() if self._details else {}),
        }
        status = DiagnosticStatus(name=self._name, hardware_id=self._hardware_id)
        status.level, status.message = self._judge(previous, now, last_drop)
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _pair_values(self) -> dict[str, int]:
        ledger = self.pairs
        if not ledger.taken:
            return {}
        lost = {
            f'{PAIRS}: {reason}': count for reason, count in sorted(ledger.lost.copy().items())
        }
        return {PAIRS: ledger.taken, PAIRS_USED: ledger.used, **lost}

    def _judge(self, previous: _Counts, now: _Counts, last_drop: str) -> tuple[bytes, str]:
        errors = '; '.join(filter(None, self.errors.values()))
        if errors:
            return DiagnosticStatus.ERROR, errors
        if self._intruders:
            return DiagnosticStatus.WARN, '; '.join(self._intruders.values())
        if self._clocks:
            return DiagnosticStatus.WARN, '; '.join(self._clocks.values())
        if self.idle:
            return DiagnosticStatus.OK, self.idle
        if now.received == previous.received:
            return DiagnosticStatus.STALE, 'no input'
        if now.lost > previous.lost:
            return DiagnosticStatus.WARN, f'{now.lost - previous.lost} lost on the way here'
        if now.dropped > previous.dropped:
            count = now.dropped - previous.dropped
            return DiagnosticStatus.WARN, f'{count} dropped: {last_drop}'
        if now.published == previous.published:
            return DiagnosticStatus.WARN, 'something comes in, and nothing goes out'
        if cautions := '; '.join(filter(None, self._cautions.values())):
            return DiagnosticStatus.WARN, cautions
        return DiagnosticStatus.OK, 'running'

    def _look_about(self) -> None:
        # Seen twice, as one that has just ended is known for a moment longer.
        seen = self._neighbours.intruders(self._node.sole_topics)
        found = {about: told for about, told in seen.items() if self._seen.get(about) == told}
        news = [told for about, told in found.items() if self._intruders.get(about) != told]
        self._seen, self._intruders = seen, found
        for told in news:
            self._node.get_logger().warning(told)
        if news:
            self.publish()

    def _look_at_clocks(self) -> None:
        # In two seconds running, as a node that was held up takes all in at once.
        troubles = self._node.clock_troubles()
        standing = {topic: told for topic, told in troubles.items() if topic in self._odd_clocks}
        for topic in standing.keys() - self._clocks.keys():
            self._node.get_logger().warning(standing[topic])
        self._odd_clocks, self._clocks = troubles, standing

    def _remember(self) -> None:
        with self._lock:
            dropped = self.dropped.total()
        self._past.append(
            _Counts(
                time.monotonic(),
                self.received.total(),
                self.published,
                dropped,
                self._node.lost.total(),
            )
        )


class _Counts(NamedTuple):
    """What a stage has counted at an instant of `time.monotonic`."""

    time: float
    received: int
    published: int
    dropped: int
    lost: int
