"""What playing a bag needs besides ROS: the schedule, reading ahead, and the options."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.records import Record, TopicInfo
from binopos_ros.parameters import option

_SECOND = 10**9
_READ_AHEAD_MESSAGES = 1000
_READ_AHEAD_BYTES = 64 << 20


@dataclass(frozen=True)
class PlayerOptions:
    """How to play a bag; the names are those of `ros2 bag play`."""

    bag: str = option('', 'bag: folder or .mcap file', read_only=True)
    rate: float = option(1.0, 'speed of playing, 1 is real time', limits=(0.01, 100.0))
    loop: bool = option(False, 'begin again at the end', read_only=True)
    start_offset: float = option(
        0.0, 'begin this long after the start of the bag', 's', limits=(0.0, 1e9), read_only=True
    )
    topics: tuple[str, ...] = option((), 'topics to play, all where empty', read_only=True)
    remap: tuple[str, ...] = option((), 'names to publish under, FROM:=TO', read_only=True)
    clock: float = option(
        0.0,
        'publish the time of the bag on /clock at this rate, 0: never',
        'Hz',
        limits=(0.0, 10000.0),
        read_only=True,
    )
    start_paused: bool = option(False, 'wait for the resume service', read_only=True)
    wait_for_all_acked: int = option(
        1000,
        'at the end wait for every acknowledgement, 0: for ever, -1: do not',
        'ms',
        limits=(-1, 3600000),
        read_only=True,
    )
    wait_for_subscribers: float = option(
        5.0,
        'longest wait for subscribers before the first message, 0: none',
        's',
        limits=(0.0, 3600.0),
        read_only=True,
    )

    def __post_init__(self) -> None:
        renaming(self.remap)

    def published_name(self, topic: str) -> str:
        """Absolute name under which a topic of the bag is published."""
        return renaming(self.remap)(topic)


def renaming(rules: Sequence[str]) -> Callable[[str], str]:
    """The absolute name that rules FROM:=TO give to a topic.

    Raises:
        BagError: a rule is malformed.
    """
    names: dict[str, str] = {}
    for rule in rules:
        source, separator, target = rule.partition(':=')
        if not (source and separator and target):
            message = f"remap rule '{rule}': write FROM:=TO"
            raise BagError(message)
        names[absolute(source)] = absolute(target)
    return lambda topic: names.get(absolute(topic), absolute(topic))


def absolute(topic: str) -> str:
    """A topic's name with its leading slash, which some bags leave out."""
    return topic if topic.startswith('/') else f'/{topic}'


def chosen_topics(reader: Playable, wanted: tuple[str, ...]) -> list[str]:
    """The bag's topics that are wanted, all where nothing is.

    Raises:
        BagError: a wanted topic is not in the bag.
    """
    by_name = {absolute(topic): topic for topic in reader.topics}
    for topic in wanted:
        if absolute(topic) not in by_name:
            known = ', '.join(sorted(by_name)) or 'none'
            message = f'{reader.path}: no topic {topic} in this bag; its topics: {known}'
            raise BagError(message)
    return [by_name[absolute(topic)] for topic in wanted] if wanted else list(reader.topics)


class Playable(Protocol):
    """What the player plays: a `BagReader`, or a view of one."""

    @property
    def path(self) -> Path:
        """Where the bag lies."""

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Its topics by name."""

    @property
    def start_ns(self) -> int:
        """Time of the first message."""

    @property
    def end_ns(self) -> int:
        """Time of the last message."""

    @property
    def message_count(self) -> int:
        """Number of messages."""

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Messages in the order of their log time."""


class Schedule:
    """The time of the bag as a function of the time of the world.

    World time is in seconds of a clock that never jumps, bag time in nanoseconds.
    """

    def __init__(self, clock: Callable[[], float], rate: float = 1.0) -> None:
        self._clock = clock
        self._rate = rate
        self._bag_ns = 0
        self._world = 0.0
        self.started = False
        self.paused = False

    @property
    def rate(self) -> float:
        """Seconds of bag per second of the world."""
        return self._rate

    def start(self, bag_ns: int) -> None:
        """It is `bag_ns` now."""
        self._bag_ns, self._world = bag_ns, self._clock()
        self.started = True

    def now_ns(self) -> int:
        """The time of the bag."""
        if self.paused or not self.started:
            return self._bag_ns
        return self._bag_ns + round((self._clock() - self._world) * self._rate * _SECOND)

    def world_of(self, bag_ns: int) -> float:
        """When it was or will be `bag_ns`, if nothing pauses the bag until then."""
        return self._world + (bag_ns - self._bag_ns) / (_SECOND * self._rate)

    def pause(self) -> None:
        """Hold the time of the bag."""
        self._hold()
        self.paused = True

    def resume(self) -> None:
        """Let the time of the bag run on from where it was held."""
        self._hold()
        self.paused = False

    def set_rate(self, rate: float) -> None:
        """Change the speed from now on."""
        self._hold()
        self._rate = rate

    def skip_to(self, bag_ns: int) -> None:
        """Jump to `bag_ns`; a paused bag stays paused."""
        self._bag_ns, self._world = bag_ns, self._clock()

    def _hold(self) -> None:
        self._bag_ns, self._world = self.now_ns(), self._clock()


class ReadAhead:
    """Messages read by a thread of its own, so that a slow disk does not hold up the schedule.

    At most 1000 messages or 64 MiB wait at a time.
    """

    def __init__(self, source: Callable[[], Iterator[Record]]) -> None:
        self._source = source
        self._records: queue.Queue[Record | BaseException | None] = queue.Queue(
            _READ_AHEAD_MESSAGES
        )
        self._bytes = 0
        self._room = threading.Condition()
        self._stopped = False
        self._thread = threading.Thread(target=self._read, name='bag-read-ahead', daemon=True)
        self._thread.start()

    def __iter__(self) -> Iterator[Record]:
        while True:
            item = self._records.get()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            with self._room:
                self._bytes -= len(item.data)
                self._room.notify()
            yield item

    def stop(self) -> None:
        """End the thread."""
        with self._room:
            self._stopped = True
            self._room.notify()
        while self._thread.is_alive():
            # The thread may wait for a place in the queue.
            try:
                self._records.get_nowait()
            except queue.Empty:
                self._thread.join(0.01)

    def _read(self) -> None:
        try:
            for record in self._source():
                with self._room:
                    self._room.wait_for(lambda: self._stopped or self._bytes < _READ_AHEAD_BYTES)
                    if self._stopped:
                        return
                    self._bytes += len(record.data)
                self._records.put(record)
            self._records.put(None)
        except Exception as error:
            # Whatever ends the reading is raised where the messages are played.
            self._records.put(error)
