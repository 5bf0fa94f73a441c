"""The recorder node: topics into a bag, serialised as they arrive."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter
from rclpy.topic_endpoint_info import TopicEndpointInfo

from binopos_ros.bag import BagError
from binopos_ros.bag.definitions import Definition, definition_of, installed_definition
from binopos_ros.bag.messages import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    ODOMETRY,
    POSE,
    POSE_WITH_COVARIANCE,
    STATUS,
    TF,
    VECTOR3,
)
from binopos_ros.bag.recording import RecorderOptions, Recording
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.hearing import Hearing
from binopos_ros.nodes.interfaces import installed_class
from binopos_ros.nodes.offers import Request, offer_of
from binopos_ros.nodes.running import run
from binopos_ros.nodes.shell import StageNode
from binopos_ros.nodes.snapshot import Snapshot
from binopos_ros.nodes.triggers import offer_triggers
from binopos_ros.sides import SIDES

#: The suite's topics, relative to the node's namespace, and their types.
SUITE = {
    f'{side}/{topic}': kind
    for side in SIDES
    for topic, kind in (
        ('image_raw/compressed', COMPRESSED_IMAGE),
        ('image_raw', IMAGE),
        ('camera_info', CAMERA_INFO),
        ('centroid', POSE_WITH_COVARIANCE),
    )
} | {
    'target/position': POSE_WITH_COVARIANCE,
    'target/systematic': POSE_WITH_COVARIANCE,
    'target/medium': POSE_WITH_COVARIANCE,
    'target/refractive_index': VECTOR3,
    'target/pose': POSE_WITH_COVARIANCE,
    'target/odometry': ODOMETRY,
    'target/pose_stamped': POSE,
    'target/health': STATUS,
    'target/markers': 'visualization_msgs/msg/MarkerArray',
    'platform/odometry': ODOMETRY,
    '/tf': TF,
    '/tf_static': TF,
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}
#: Seconds between looks at what is published.
DISCOVERY = 0.2


class RecorderNode(StageNode):
    """Records the suite's topics from their first message, others as they appear.

    Attributes:
        failure: why recording ended by itself, '' where it did not.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder', **options)
        self.failure = ''
        settings: RecorderOptions = self.declare_options(RecorderOptions, lambda _: None)
        if not settings.bag:
            message = "no bag given: set the parameter 'bag' to the folder to make"
            raise BagError(message)
        self._settings = settings
        named = settings.topics or (() if settings.regex else SUITE)
        self._wanted = {self.resolve_topic_name(topic) for topic in named}
        self._refused: set[str] = set()
        self._heard: dict[str, Hearing] = {}
        self._types: dict[str, str] = {}
        self._recorded: set[str] = set()
        self._lost: dict[str, int] = {}
        self._recording = Recording(settings)
        self._diagnostics = StageDiagnostics(self, settings.bag, self._details)
        self._snapshot = Snapshot(self, Path(settings.bag))
        self._sides = {self.resolve_topic_name(f'{side}/camera_info'): side for side in SIDES}
        for topic, type_name in SUITE.items():
            full_name = self.resolve_topic_name(topic)
            # No wheel has it: without it, transforms are heard of and not recorded.
            if type_name == TF and installed_class(type_name) is None:
                continue
            if settings.wants(full_name, self._wanted):
                # Before anybody publishes, so that nothing is missed while it is found.
                self._hear(full_name, type_name).ask(Request(reliable=True, latched=False))
        self._offer_controls()
        self.every(DISCOVERY, self._look)
        self.get_logger().info(f'recording to {settings.bag}')

    def destroy_node(self) -> None:
        """Finish the bag."""
        if hasattr(self, '_recording'):
            self._recording.close()
            self.failure = self._recording.failure
        super().destroy_node()

    def summary(self) -> str:
        """What was recorded, in a line."""
        lost = sum(self._lost.values()) + self._recording.overflow
        return (
            f'{self._settings.bag}: {self._recording.written} messages of '
            f'{len(self._recorded)} topics recorded, {lost} lost'
        )

    def _look(self) -> None:
        if self._recording.failure:
            self._diagnostics.errors['bag'] = self._recording.failure
            self._diagnostics.publish()
            self.context.try_shutdown()
            return
        for topic, types in self.get_topic_names_and_types():
            if topic in self._refused or not self._settings.wants(topic, self._wanted):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if not offers:
                continue
            self._announce(topic, types[0], offers)
            if topic in self._refused:
                continue
            heard = self._heard[topic]
            heard.adapt(offer.qos_profile for offer in offers)

    def _hear(self, topic: str, type_name: str) -> Hearing:
        message_class = installed_class(type_name)
        if message_class is None:
            message = f'message type {type_name} is not installed'
            raise BagError(message)
        self._types[topic] = type_name
        self._heard[topic] = Hearing(
            self, message_class, topic, self._taking(topic), self._losing(topic)
        )
        return self._heard[topic]

    def _announce(self, topic: str, type_name: str, offers: Sequence[TopicEndpointInfo]) -> None:
        """Make a topic known to the bag, as its publishers offer it."""
        if topic in self._recorded:
            return
        try:
            if topic not in self._heard or type_name != self._types[topic]:
                self._hear(topic, type_name)
            definition = _definition(type_name, offers)
        except BagError as error:
            self._refused.add(topic)
            self.get_logger().warning(f'topic {topic} is not recorded: {error}')
            return
        self._recorded.add(topic)
        self._recording.add_topic(
            topic, type_name, tuple(offer_of(offer.qos_profile) for offer in offers), definition
        )
        self.get_logger().info(f'recording {topic}')

    def _taking(self, topic: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            # The first message may be quicker than the next look about.
            offers = [] if topic in self._recorded else self.get_publishers_info_by_topic(topic)
            self._announce(topic, self._types[topic], offers)
            if topic in self._refused:
                return
            self._diagnostics.received[topic] += 1
            if topic in self._sides:
                self._snapshot.calibration(self._sides[topic], data)
            if self._recording.write(topic, self.get_clock().now().nanoseconds, data):
                self._diagnostics.published += 1
            elif not self._recording.failure:
                self._diagnostics.drop('the disk does not keep pace')

        return take

    def _losing(self, topic: str) -> Callable[[int], None]:
        def lose(count: int) -> None:
            self._lost[topic] = self._lost.get(topic, 0) + count
            self._diagnostics.drop('lost on the way', count)

        return lose

    def _offer_controls(self) -> None:
        """Offer the services ~/pause, ~/resume and so on, named as rosbag2 names them."""
        recording = self._recording

        def pause() -> tuple[bool, str]:
            recording.pause()
            return True, 'paused'

        def resume() -> tuple[bool, str]:
            recording.resume(self.get_clock().now().nanoseconds)
            return True, 'recording'

        def split() -> tuple[bool, str]:
            try:
                recording.split()
            except BagError as error:
                return False, str(error)
            return True, 'a new file begins'

        def snapshot() -> tuple[bool, str]:
            try:
                count = recording.take_snapshot()
            except BagError as error:
                return False, str(error)
            return True, f'{count} messages go to {self._settings.bag}'

        offer_triggers(
            self,
            {
                'pause': pause,
                'resume': resume,
                'toggle_paused': lambda: resume() if recording.paused else pause(),
                'is_paused': lambda: (True, 'paused' if recording.paused else 'recording'),
                'split_bagfile': split,
                'snapshot': snapshot,
            },
        )

    def _details(self) -> dict[str, object]:
        return {
            'Bag': self._settings.bag,
            'State': 'paused' if self._recording.paused else 'recording',
            'Topics': len(self._recorded),
            'Recorded (s)': f'{self._recording.duration:.1f}',
            'Free space (GB)': f'{self._recording.free_space / 1e9:.3f}',
            **{f'Lost {topic}': count for topic, count in sorted(self._lost.items())},
        }


def _definition(type_name: str, offers: Sequence[TopicEndpointInfo]) -> Definition:
    """The definition that the publishers' hash names, Jazzy's own or the installed one."""
    hashes = {str(offer.topic_type_hash) for offer in offers}
    type_hash = next((each for each in hashes if each.startswith('RIHS01_')), '')
    try:
        ours = definition_of(type_name)
    except BagError:
        return installed_definition(type_name, type_hash)
    if type_hash in ('', ours.type_hash):
        return ours
    return installed_definition(type_name, type_hash)


def record(words: Sequence[str], typed: Sequence[Parameter] = ()) -> int:
    """Run a recorder; the exit status, 1 where recording broke off.

    Args:
        words: those after `--ros-args`.
        typed: parameters that go over them.
    """
    nodes: list[RecorderNode] = []

    def recorder(parameter_overrides: Sequence[Parameter]) -> RecorderNode:
        nodes.append(RecorderNode(parameter_overrides=[*parameter_overrides, *typed]))
        return nodes[0]

    status = run({'recorder': recorder}, words)
    for node in nodes:
        # Its logger went down with the context.
        print(node.summary(), flush=True)
        if node.failure:
            print(f'recorder: {node.failure}', file=sys.stderr)
            return 1
    return status
