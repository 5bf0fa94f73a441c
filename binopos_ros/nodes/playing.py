"""Playing a bag through publishers: its messages, serialised as they were recorded."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import NamedTuple

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosgraph_msgs.msg import Clock

from binopos_ros.bag import BagError, Record
from binopos_ros.bag.messages import CAMERA_INFO
from binopos_ros.bag.playback import (
    Playable,
    PlayerOptions,
    ReadAhead,
    Schedule,
    absolute,
    chosen_topics,
)
from binopos_ros.nodes.interfaces import playable_class
from binopos_ros.nodes.neighbours import publishers_of
from binopos_ros.nodes.offers import profile_offered
from binopos_ros.nodes.shell import POLICIES, one_line
from binopos_ros.nodes.transforms import TF, TF_STATIC

#: What the stages subscribe to, foremost first: a bag that holds the first plays through all.
INPUTS = (
    ('image_raw', 'image_raw/compressed', 'camera_info'),
    ('left/centroid', 'right/centroid', 'camera_info'),
    ('target/position',),
)
#: A publisher sees a subscriber before that subscriber has seen it; the rest comes within this.
SETTLING = 0.3
POLL = 0.02


class Latched(NamedTuple):
    """A serialised message that is published once, for all who come later too."""

    message_class: type
    data: bytes


class Player:
    """Plays a bag through publishers of a node, in a thread of its own.

    `start` returns at once. The thread waits for subscribers, plays, waits for acknowledgements
    and sets `finished`. The node must not be destroyed before `stop` has returned. `latched`
    messages, by topic, take the place of all that the bag has on those topics. `told` gets each
    record once it is published, in that thread.

    Attributes:
        counts: messages published so far, by their topic in the bag.
        skipped: topics that are not played, and why.
        latest: the farthest that a message was behind its schedule, in seconds.
        error: why playing broke off, '' where it did not.
        finished: set when nothing more will be published.

    Raises:
        BagError: a topic that is asked for is not in the bag, or nothing can be played.
    """

    def __init__(
        self,
        node: Node,
        reader: Playable,
        options: PlayerOptions | None = None,
        latched: Mapping[str, Latched] | None = None,
        told: Callable[[Record], None] = lambda _: None,
    ) -> None:
        self.options = options or PlayerOptions()
        self.counts: Counter[str] = Counter()
        self.skipped: dict[str, str] = {}
        self.latest = 0.0
        self.error = ''
        self.finished = threading.Event()
        self._node = node
        self._reader = reader
        self._schedule = Schedule(time.monotonic, self.options.rate)
        self._changed = threading.Condition()
        self._stopped = False
        self._steps = 0
        self._silent: list[Publisher] = []
        self._latched = latched or {}
        self._told = told
        self._publishers = self._make_publishers()
        self._offer_latched()
        self._clock = (
            node.create_publisher(Clock, '/clock', QoSProfile(depth=1))
            if self.options.clock > 0
            else None
        )
        self._next_tick = 0.0
        self._thread = threading.Thread(target=self._run, name='bag-player', daemon=True)
        if self.options.start_paused:
            self._schedule.pause()

    @property
    def published(self) -> int:
        """Messages published so far."""
        return self.counts.total()

    @property
    def topics(self) -> list[str]:
        """Names in the bag of the topics that are played."""
        return list(self._publishers)

    @property
    def paused(self) -> bool:
        """Whether the bag's time is held."""
        return self._schedule.paused

    def start(self) -> None:
        """Begin to play."""
        self._thread.start()

    def stop(self) -> None:
        """Break off, if it is not finished; returns when nothing more is published."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join()

    def wall_time_of(self, stamp_ns: int) -> float | None:
        """When the bag's time was or will be `stamp_ns`, in seconds of `time.monotonic`.

        None before the first message is due. While a bag loops, the current round counts.
        """
        with self._changed:
            return self._schedule.world_of(stamp_ns) if self._schedule.started else None

    def pause(self) -> None:
        """Hold the bag's time."""
        with self._changed:
            self._schedule.pause()
            self._changed.notify()

    def resume(self) -> None:
        """Let the bag's time run on."""
        with self._changed:
            self._schedule.resume()
            self._changed.notify()

    def set_rate(self, rate: float) -> None:
        """Change the speed."""
        with self._changed:
            self._schedule.set_rate(rate)
            self._changed.notify()

    def play_next(self) -> bool:
        """Publish one message of a paused bag; False where it is not paused."""
        with self._changed:
            if not self._schedule.paused or self.finished.is_set():
                return False
            self._steps += 1
            self._changed.notify()
            return True

    def _make_publishers(self) -> dict[str, Publisher]:
        publishers: dict[str, Publisher] = {}
        for topic in chosen_topics(self._reader, self.options.topics):
            if absolute(topic) in self._latched:
                continue
            info = self._reader.topics[topic]
            message_class, reason = playable_class(info)
            if message_class is not None:
                try:
                    publishers[topic] = self._node.create_publisher(
                        message_class,
                        self.options.published_name(topic),
                        profile_offered(info.qos),
                        qos_overriding_options=QoSOverridingOptions(POLICIES),
                    )
                except InvalidTopicNameException as error:
                    reason = f'its name is invalid: {one_line(error)}'
            if reason:
                self.skipped[topic] = reason
                self._node.get_logger().warning(f'topic {topic} is not played: {reason}')
        if not publishers:
            reasons = '; '.join(f'{topic}: {why}' for topic, why in self.skipped.items())
            message = f'{self._reader.path}: nothing to play ({reasons or "no topics"})'
            raise BagError(message)
        return publishers

    def _offer_latched(self) -> None:
        profile = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._keepers = [
            (self._node.create_publisher(kind, self.options.published_name(topic), profile), data)
            for topic, (kind, data) in self._latched.items()
        ]
        for publisher, data in self._keepers:
            publisher.publish(data)

    def _run(self) -> None:
        try:
            self._wait_for_subscribers()
            self._yield_to_others()
            rounds = 0
            while not self._stopped and (rounds == 0 or self.options.loop):
                rounds += 1
                self._play_round()
            if not self._stopped:
                self._wait_for_acknowledgements()
        except BagError as error:
            self.error = str(error)
            self._node.get_logger().error(str(error))
        finally:
            self.finished.set()

    def _yield_to_others(self) -> None:
        """Leave topics out that somebody publishes already: everything would come twice."""
        own = self._node.get_fully_qualified_name()
        for topic in self.topics:
            name = self._publishers[topic].topic_name
            others = set(publishers_of(self._node, name)) - {own}
            # Transforms are of many publishers, each with frames of its own.
            if others and name not in (TF, TF_STATIC):
                # Not destroyed: the node may be spinning in another thread.
                self._silent.append(self._publishers.pop(topic))
                reason = f'{" and ".join(sorted(others))} publishes it already'
                self.skipped[topic] = reason
                self._node.get_logger().warning(f'topic {topic} is not played: {reason}')
        if not self._publishers:
            message = f'{self._reader.path}: nothing to play: other nodes publish all its topics'
            raise BagError(message)

    def _play_round(self) -> None:
        start_ns = self._reader.start_ns + round(self.options.start_offset * 1e9)
        if start_ns > self._reader.end_ns and self._reader.message_count:
            length = (self._reader.end_ns - self._reader.start_ns) * 1e-9
            message = (
                f'{self._reader.path}: start offset {self.options.start_offset:g} s lies behind '
                f'the end of the bag, which is {length:.1f} s long'
            )
            raise BagError(message)
        for record in self._standing_before(start_ns):
            self._publish(record)
        with self._changed:
            self._schedule.start(start_ns)
        ahead = ReadAhead(lambda: self._reader.messages(self._publishers, start_ns))
        try:
            for record in ahead:
                if not self._wait_until(record.stamp_ns):
                    return
                self._publish(record)
        finally:
            ahead.stop()

    def _standing_before(self, start_ns: int) -> list[Record]:
        """The last message of each topic whose messages hold until the next: calibrations.

        A calibration that the bag holds only later comes before the images too.
        """
        standing = [
            topic
            for topic in self._publishers
            if self._reader.topics[topic].type == CAMERA_INFO
            or any(
                offer.durability == 'transient_local' for offer in self._reader.topics[topic].qos
            )
        ]
        last: dict[str, Record] = {}
        if standing and start_ns > self._reader.start_ns:
            for record in self._reader.messages(standing):
                if record.stamp_ns >= start_ns:
                    break
                last[record.topic] = record
        for topic in standing:
            if topic not in last and self._reader.topics[topic].type == CAMERA_INFO:
                first = next(self._reader.messages([topic]), None)
                if first is not None and first.stamp_ns > start_ns:
                    last[topic] = first
        return list(last.values())

    def _wait_until(self, stamp_ns: int) -> bool:
        """Sleep until a message is due or stepped to; False where the player was stopped."""
        with self._changed:
            while not self._stopped:
                now = time.monotonic()
                self._tick(now)
                if self._schedule.paused:
                    if self._steps:
                        self._steps -= 1
                        self._schedule.skip_to(stamp_ns)
                        return True
                    self._changed.wait(self._until_tick(now, None))
                    continue
                remaining = self._schedule.world_of(stamp_ns) - now
                if remaining <= 0:
                    self.latest = max(self.latest, -remaining)
                    return True
                self._changed.wait(self._until_tick(now, remaining))
        return False

    def _publish(self, record: Record) -> None:
        self._publishers[record.topic].publish(record.data)
        self._told(record)
        self.counts[record.topic] += 1

    def _tick(self, now: float) -> None:
        if self._clock is None or now < self._next_tick:
            return
        self._next_tick = max(self._next_tick + 1 / self.options.clock, now)
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(self._schedule.now_ns(), 10**9)
        self._clock.publish(message)

    def _until_tick(self, now: float, seconds: float | None) -> float | None:
        if self._clock is None:
            return seconds
        tick = max(self._next_tick - now, 0.0)
        return tick if seconds is None else min(seconds, tick)

    def _wait_for_subscribers(self) -> None:
        awaited = self._awaited()
        deadline = time.monotonic() + self.options.wait_for_subscribers
        while not self._stopped and (missing := self._unmatched(awaited)):
            if time.monotonic() >= deadline:
                if self.options.wait_for_subscribers > 0:
                    self._node.get_logger().warning(
                        f'nobody subscribes to {", ".join(missing)}: playing anyway'
                    )
                return
            time.sleep(POLL)
        if not self._stopped and self.options.wait_for_subscribers > 0:
            time.sleep(SETTLING)

    def _awaited(self) -> list[str]:
        for names in INPUTS:
            found = [topic for topic in self._publishers if absolute(topic).endswith(names)]
            if any(not topic.endswith('camera_info') for topic in found):
                return found
        return []

    def _unmatched(self, awaited: list[str]) -> list[str]:
        """Awaited topics without a subscriber; where none is awaited, all until one has one."""
        counts = {
            topic: publisher.get_subscription_count()
            for topic, publisher in self._publishers.items()
        }
        if awaited:
            return [topic for topic in awaited if counts[topic] == 0]
        return [] if any(counts.values()) else list(counts)

    def _wait_for_acknowledgements(self) -> None:
        milliseconds = self.options.wait_for_all_acked
        if milliseconds < 0:
            return
        deadline = time.monotonic() + milliseconds * 1e-3
        for topic, publisher in self._publishers.items():
            # In short waits, so that a stop is heeded.
            while not self._stopped and not publisher.wait_for_all_acked(Duration(seconds=0.1)):
                if milliseconds and time.monotonic() >= deadline:
                    self._node.get_logger().warning(
                        f'not every subscriber acknowledged {topic} within {milliseconds} ms'
                    )
                    return
