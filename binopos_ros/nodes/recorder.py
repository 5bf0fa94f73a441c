"""The recorder node: topics into a bag, serialised as they arrive."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks
from rclpy.parameter import Parameter
from rclpy.topic_endpoint_info import TopicEndpointInfo

from binopos_ros.bag import BagError
from binopos_ros.bag.definitions import Definition, definition_of, installed_definition
from binopos_ros.bag.recording import RecorderOptions, Recording
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.interfaces import installed_class
from binopos_ros.nodes.offers import offer_of, profile_requested
from binopos_ros.nodes.running import run
from binopos_ros.nodes.shell import StageNode
from binopos_ros.sides import SIDES

#: The suite's topics, relative to the node's namespace.
SUITE = (
    *(
        f'{side}/{topic}'
        for side in SIDES
        for topic in ('image_raw/compressed', 'image_raw', 'camera_info', 'centroid')
    ),
    'target/position',
    'target/refractive_index',
    'target/pose',
    'target/odometry',
    'target/markers',
    '/diagnostics',
)
#: Seconds between looks at what is published.
DISCOVERY = 0.2


class RecorderNode(StageNode):
    """Records topics as they appear.

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
        self._wanted = {self.resolve_topic_name(topic) for topic in (settings.topics or SUITE)}
        self._seen: set[str] = set()
        self._recorded: set[str] = set()
        self._lost: dict[str, int] = {}
        self._recording = Recording(settings)
        self._diagnostics = StageDiagnostics(self, settings.bag, self._details)
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
            if topic in self._seen or not (self._settings.all or topic in self._wanted):
                continue
            offers = self.get_publishers_info_by_topic(topic)
            if offers:
                self._seen.add(topic)
                self._subscribe(topic, types[0], offers)

    def _subscribe(self, topic: str, type_name: str, offers: Sequence[TopicEndpointInfo]) -> None:
        message_class = installed_class(type_name)
        if message_class is None:
            self.get_logger().warning(
                f'topic {topic} is not recorded: message type {type_name} is not installed'
            )
            return
        try:
            definition = _definition(type_name, offers)
        except BagError as error:
            self.get_logger().warning(f'topic {topic} is not recorded: {error}')
            return
        self._recorded.add(topic)
        self._recording.add_topic(
            topic, type_name, tuple(offer_of(offer.qos_profile) for offer in offers), definition
        )
        self.create_subscription(
            message_class,
            topic,
            self._taking(topic),
            profile_requested([offer.qos_profile for offer in offers]),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._losing(topic)),
        )
        self.get_logger().info(f'recording {topic}')

    def _taking(self, topic: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            self._diagnostics.received[topic] += 1
            if self._recording.write(topic, self.get_clock().now().nanoseconds, data):
                self._diagnostics.published += 1
            elif not self._recording.failure:
                self._diagnostics.drop('the disk does not keep pace')

        return take

    def _losing(self, topic: str) -> Callable[[QoSMessageLostInfo], None]:
        def lose(info: QoSMessageLostInfo) -> None:
            self._lost[topic] = self._lost.get(topic, 0) + info.total_count_change
            self._diagnostics.drop('lost on the way', info.total_count_change)

        return lose

    def _details(self) -> dict[str, object]:
        return {
            'Bag': self._settings.bag,
            'Topics': len(self._recorded),
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
