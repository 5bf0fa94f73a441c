"""What `binopos replay` watches: poses, truth and diagnostics, gathered into a report."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile

from binopos_ros.bag.messages import position_of, stamp_of
from binopos_ros.node_options import STAGES
from binopos_ros.nodes.diagnostics import PAIRS, PAIRS_USED, REACHED
from binopos_ros.nodes.neighbours import publishers_of
from binopos_ros.nodes.shell import every_message
from binopos_ros.reasons import Ledger, count_reason
from binopos_ros.report import Report, Track

#: What must be published and subscribed to before the suite passes anything through.
CHAIN = ('left/centroid', 'right/centroid', 'target/position')
#: The nodes that pairs pass through, in this order.


class Monitor(Node):
    """Gathers what the live nodes make of a bag.

    Args:
        namespace: of the nodes.
        report: is filled.
        wall_time_of: when a stamp of the bag was due, in seconds of `time.monotonic`.
    """

    def __init__(
        self, namespace: str, report: Report, wall_time_of: Callable[[int], float | None]
    ) -> None:
        super().__init__('monitor', namespace=namespace)
        self.last_news = time.monotonic()
        self.last_diagnostics: dict[str, float] = {}
        self._report = report
        self._wall_time_of = wall_time_of
        self.ledgers = {node: Ledger() for node in STAGES}
        self._values: dict[str, dict[str, str]] = {}
        pose = PoseWithCovarianceStamped
        # A node that was held up sends many at once.
        self.create_subscription(pose, 'target/position', self._on_position, every_message())
        self.create_subscription(pose, 'target/pose', self._on_pose, every_message())
        for topic, truth in (
            ('truth/pose', report.truth),
            ('truth/fixed_pose', report.fixed_truth),
        ):
            self.create_subscription(pose, topic, partial(_on_truth, truth), every_message())
        self.create_subscription(
            DiagnosticArray, '/diagnostics', self._on_diagnostics, QoSProfile(depth=20)
        )

    def missing(self) -> list[str]:
        """Topics of the chain that somebody does not publish or does not subscribe to yet."""
        unconnected = [
            topic
            for topic in CHAIN
            if not (self.count_publishers(self._full(topic)) and self._listeners(topic))
        ]
        if not self.count_publishers(self._full('target/pose')):
            unconnected.append('target/pose')
        return unconnected

    def unreached(self) -> list[str]:
        """Topics of the nodes that do not reach all who subscribe yet, by what the nodes say."""
        if len(self._values) < len(STAGES):
            return [f'diagnostics of the {node}' for node in STAGES if node not in self._values]
        reached = {
            key.removeprefix(REACHED): int(value)
            for values in self._values.values()
            for key, value in values.items()
            if key.startswith(REACHED)
        }
        return [topic for topic, count in reached.items() if count < self.count_subscribers(topic)]

    def second_suite(self) -> str:
        """Whether more than one suite publishes the poses: '' or by whom."""
        topic = self._full('target/pose')
        names = publishers_of(self, topic)
        if len(names) < 2:
            return ''
        return (
            f'{topic} is published by {len(names)} nodes: {", ".join(names)}. Another '
            'suite runs on this ROS domain: stop it, or set another ROS_DOMAIN_ID'
        )

    def is_done_since(self, instant: float) -> bool:
        """Whether every node has told since, in `time.monotonic`, that it holds no pair."""
        heard = self.last_diagnostics.values()
        return (
            bool(heard)
            and min(heard) > instant
            and all(each.taken == each.used + each.lost.total() for each in self.ledgers.values())
        )

    def _listeners(self, topic: str) -> int:
        own = topic == 'target/position'
        return self.count_subscribers(self._full(topic)) - own

    def _full(self, topic: str) -> str:
        return f'{self.get_namespace().rstrip("/")}/{topic}'

    def _on_position(self, message: PoseWithCovarianceStamped) -> None:
        self._report.raw.add(stamp_of(message), position_of(message))

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        now = time.monotonic()
        stamp = stamp_of(message)
        self.last_news = now
        self._report.filtered.add(stamp, position_of(message))
        due = self._wall_time_of(stamp)
        if due is not None:
            self._report.latencies.append(now - due)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            namespace, _, node = f'/{status.name.removesuffix(": stage")}'.rpartition('/')
            if namespace != self.get_namespace().rstrip('/'):
                # Of another rig on this domain.
                continue
            self.last_diagnostics[node] = time.monotonic()
            self._count(node, {item.key: item.value for item in status.values})

    def account(self, at_stamps: bool, interrupted: bool) -> None:
        """Count in the report what became of the pairs that gave no pose, by the nodes' own books.

        What one node handed on and the next never had was lost on the way between them, or with
        the books of a node that died.

        Args:
            at_stamps: whether the smoother gives one pose for each pair that it uses.
            interrupted: whether pairs may still be on their way, and books a second old.
        """
        for node, ledger in self.ledgers.items():
            for reason, count in ledger.lost.items():
                self._lose(f'smoother: {reason}' if node == 'smoother' else reason, count)
        poses = len(self._report.filtered.stamps)
        if interrupted:
            rest = self._report.seen - self._report.drops.total() - poses
            self._lose('on their way when it was interrupted', rest)
            return
        self._mend(poses if at_stamps else 0)
        handed_on = self._report.seen
        for node, ledger in self.ledgers.items():
            self._lose(f'did not reach the {node}', handed_on - ledger.taken)
            ended = ledger.used + ledger.lost.total()
            self._lose(f'unfinished in the {node}', ledger.taken - ended)
            handed_on = ledger.used
        if at_stamps:
            self._lose('did not come back from the smoother', handed_on - poses)

    def _mend(self, came_out: int) -> None:
        """What came out of a node went through it, also where its last books died with it."""
        for ledger in reversed(self.ledgers.values()):
            ledger.used = max(ledger.used, came_out)
            ledger.taken = max(ledger.taken, ledger.used + ledger.lost.total())
            came_out = ledger.taken

    def _lose(self, reason: str, count: int) -> None:
        if count > 0:
            self._report.drop(reason, count)

    def _count(self, node: str, values: Mapping[str, str]) -> None:
        if node not in self.ledgers:
            return
        ledger, before = self.ledgers[node], self._values.get(node, {})
        if int(values.get(PAIRS, 0)) < int(before.get(PAIRS, 0)):
            # A node that was started again counts from nought.
            before = {}
        for key, value in values.items():
            if not key.startswith(PAIRS):
                continue
            new = int(value) - int(before.get(key, 0))
            if new:
                self.last_news = time.monotonic()
            if key == PAIRS:
                ledger.taken += new
            elif key == PAIRS_USED:
                ledger.used += new
            elif new:
                count_reason(ledger.lost, key.removeprefix(f'{PAIRS}: '), new)
        self._values[node] = dict(values)


def _on_truth(truth: Track, message: PoseWithCovarianceStamped) -> None:
    truth.add(stamp_of(message), position_of(message))
