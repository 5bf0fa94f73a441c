"""Recording: messages go through a queue to a thread that owns the bag.

The disk may stall for a second without the subscriptions noticing. Every FLUSH_PERIOD all that has
arrived is on the disk in a whole bag, so a recorder that is killed loses no more than that.
"""

from __future__ import annotations

import queue
import re
import shutil
import threading
import time
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

from binopos_ros.bag.definitions import Definition
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.mcap_file import COMPRESSIONS
from binopos_ros.bag.messages import CAMERA_INFO
from binopos_ros.bag.qos import Qos
from binopos_ros.bag.writer import BagWriter
from binopos_ros.parameters import option

FLUSH_PERIOD = 0.5
#: Large, so that time and not size ends a chunk, and a long recording's index stays small.
CHUNK_BYTES = 8 << 20
#: What may wait for a stalled disk.
QUEUE_BYTES = 256 << 20


@dataclass(frozen=True)
class RecorderOptions:
    """What to record, and where to."""

    bag: str = option('', 'folder or .mcap file to make', read_only=True)
    all: bool = option(False, "every topic, not only the suite's", read_only=True)
    topics: tuple[str, ...] = option((), "topics to record instead of the suite's", read_only=True)
    compression: str = option(
        'none', 'of the chunks; JPEG images hardly shrink', choices=COMPRESSIONS, read_only=True
    )
    max_bag_size: int = option(
        4 << 30,
        'begin a new file of the bag beyond this size, 0: never',
        'bytes',
        limits=(0, 1 << 50),
        read_only=True,
    )
    max_bag_duration: float = option(
        3600.0,
        'begin a new file of the bag after this time, 0: never',
        's',
        limits=(0.0, 1e7),
        read_only=True,
    )

    regex: str = option(
        '', "topics whose names this is found in, instead of the suite's", read_only=True
    )
    exclude_regex: str = option(
        '', 'topics whose names this is found in are left out', read_only=True
    )
    start_paused: bool = option(False, 'record nothing before ~/resume is called', read_only=True)
    snapshot: float = option(
        0.0,
        'keep this much in memory and write it when ~/snapshot is called, 0: write all at once',
        's',
        limits=(0.0, 3600.0),
        read_only=True,
    )
    snapshot_size: int = option(
        1 << 30,
        'the most that is kept for a snapshot',
        'bytes',
        limits=(1, 1 << 40),
        read_only=True,
    )
    min_free_space: int = option(
        100 << 20,
        'end the recording when less than this is left on the disk, 0: never',
        'bytes',
        limits=(0, 1 << 50),
        read_only=True,
    )

    def __post_init__(self) -> None:
        if self.all and (self.topics or self.regex):
            message = 'all excludes topics and regex: give one of them'
            raise BagError(message)
        for name in ('regex', 'exclude_regex'):
            try:
                re.compile(getattr(self, name))
            except (re.error, OverflowError, RecursionError) as error:
                message = f'{name} {getattr(self, name)!r} is no regular expression: {error}'
                raise BagError(message) from error

    def wants(self, topic: str, named: Collection[str]) -> bool:
        """Whether a topic is recorded; `named` are the full names of those asked for by name."""
        if self.exclude_regex and re.search(self.exclude_regex, topic):
            return False
        if self.all or topic in named:
            return True
        return bool(self.regex) and re.search(self.regex, topic) is not None


class _Topic(NamedTuple):
    name: str
    type: str
    qos: tuple[Qos, ...]
    definition: Definition | None


class _Message(NamedTuple):
    topic: str
    stamp_ns: int
    data: bytes


class _Split(NamedTuple):
    """Begin a new file."""


class Recording:
    """A bag that is being recorded.

    What holds until the next message of its topic (calibrations, and all that is latched) is kept,
    and written again when recording goes on after a pause, and at the head of a snapshot.

    Attributes:
        failure: why recording ended by itself (the disk is full, ...), '' while it runs.
        written: messages given to the bag.
        overflow: messages given up because the disk did not keep pace.
        paused: whether nothing is recorded for the time being.

    Raises:
        BagError: the bag cannot be created.
    """

    def __init__(self, options: RecorderOptions) -> None:
        self._options = options
        self._span = (0, 0)
        self._single = options.bag.endswith('.mcap')
        self._writer = BagWriter(
            options.bag,
            compression=options.compression,
            split_bytes=0 if self._single else options.max_bag_size,
            split_ns=0 if self._single else round(options.max_bag_duration * 1e9),
            chunk_bytes=CHUNK_BYTES,
            crash_safe=True,
        )
        self.failure = ''
        self.written = 0
        self.overflow = 0
        self.paused = options.start_paused
        self._standing: dict[str, _Message | None] = {}
        self._kept: deque[_Message] = deque()
        self._kept_bytes = 0
        self._waiting = 0
        self._lock = threading.Lock()
        self._queue: queue.SimpleQueue[_Topic | _Message | _Split | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name='bag-writer', daemon=True)
        self._thread.start()

    def add_topic(
        self,
        name: str,
        type: str,
        qos: tuple[Qos, ...] = (),
        definition: Definition | None = None,
    ) -> None:
        """Declare a topic; see `BagWriter.add_topic`."""
        if type == CAMERA_INFO or any(offer.durability == 'transient_local' for offer in qos):
            self._standing[name] = None
        self._queue.put(_Topic(name, type, qos, definition))

    def write(self, topic: str, stamp_ns: int, data: bytes) -> bool:
        """Take a serialised message; False where it was given up."""
        message = _Message(topic, stamp_ns, data)
        if topic in self._standing:
            self._standing[topic] = message
        if self.paused:
            return True
        if self._options.snapshot:
            self._keep(message)
            return True
        return self._put(message)

    def pause(self) -> None:
        """Record nothing until `resume`."""
        self.paused = True

    def resume(self, now_ns: int) -> None:
        """Record again, with what still holds first."""
        if self.paused:
            self.paused = False
            for message in self._standing.values():
                if message is not None:
                    self.write(message.topic, now_ns, message.data)

    def split(self) -> None:
        """Begin a new file of the bag.

        Raises:
            BagError: the bag is a single file.
        """
        if self._single:
            message = f'{self._options.bag}: a single .mcap file cannot be split: name a folder'
            raise BagError(message)
        self._queue.put(_Split())

    def take_snapshot(self) -> int:
        """Write what is kept in memory; the number of messages.

        Raises:
            BagError: nothing is kept, since all is written at once.
        """
        if not self._options.snapshot:
            message = 'all is written as it comes: set snapshot to keep the last seconds instead'
            raise BagError(message)
        kept, self._kept, self._kept_bytes = self._kept, deque(), 0
        if not kept:
            return 0
        held = {message.topic for message in kept}
        head = [
            message._replace(stamp_ns=kept[0].stamp_ns)
            for topic, message in self._standing.items()
            if message is not None and topic not in held
        ]
        return sum(self._put(message) for message in (*head, *kept))

    def close(self) -> None:
        """Write what is waiting and finish the bag."""
        self._queue.put(None)
        self._thread.join()

    @property
    def duration(self) -> float:
        """From the first message that was written to the last, s."""
        first, last = self._span
        return max(last - first, 0) * 1e-9

    @property
    def free_space(self) -> int:
        """What is left on the bag's disk, bytes."""
        return shutil.disk_usage(self._writer.path.absolute().parent).free

    def _put(self, message: _Message) -> bool:
        with self._lock:
            if self.failure or self._waiting + len(message.data) > self._most_waiting:
                self.overflow += not self.failure
                return False
            self._waiting += len(message.data)
        self._queue.put(message)
        return True

    @property
    def _most_waiting(self) -> int:
        """Bytes that may wait for the disk; a snapshot comes in one piece."""
        return QUEUE_BYTES + (self._options.snapshot_size if self._options.snapshot else 0)

    def _keep(self, message: _Message) -> None:
        self._kept.append(message)
        self._kept_bytes += len(message.data)
        oldest_ns = message.stamp_ns - round(self._options.snapshot * 1e9)
        while self._kept and (
            self._kept[0].stamp_ns < oldest_ns or self._kept_bytes > self._options.snapshot_size
        ):
            self._kept_bytes -= len(self._kept.popleft().data)

    def _run(self) -> None:
        try:
            self._record()
        except BagError as error:
            self.failure = str(error)
        try:
            self._writer.close()
        except BagError as error:
            self.failure = self.failure or str(error)

    def _record(self) -> None:
        flush_at = time.monotonic()
        while True:
            remaining = flush_at - time.monotonic()
            if remaining <= 0:
                self._writer.flush()
                self._check_free_space()
                flush_at = time.monotonic() + FLUSH_PERIOD
                continue
            try:
                item = self._queue.get(timeout=remaining)
            except queue.Empty:
                continue
            if item is None:
                return
            if isinstance(item, _Topic):
                self._writer.add_topic(
                    item.name, item.type, qos=item.qos, definition=item.definition
                )
            elif isinstance(item, _Split):
                self._writer.split()
            else:
                with self._lock:
                    self._waiting -= len(item.data)
                self._writer.write(item.topic, item.stamp_ns, item.data)
                self.written += 1
                self._span = (self._span[0] or item.stamp_ns, item.stamp_ns)

    def _check_free_space(self) -> None:
        least = self._options.min_free_space
        if not least:
            return
        free = self.free_space
        if free < least:
            message = (
                f'{self._options.bag}: {free >> 20} MiB are left on its disk, less than the '
                f'{least >> 20} MiB of min_free_space: recording has ended, the bag is whole'
            )
            raise BagError(message)
