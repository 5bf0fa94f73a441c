"""Recording: messages go through a queue to a thread that owns the bag.

The disk may stall for a second without the subscriptions noticing. Every FLUSH_PERIOD all that has
arrived is on the disk in a whole bag, so a recorder that is killed loses no more than that.
"""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass
from typing import NamedTuple

from binopos_ros.bag.definitions import Definition
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.mcap_file import COMPRESSIONS
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

    def __post_init__(self) -> None:
        if self.all and self.topics:
            message = 'all and topics exclude each other: give one of them'
            raise BagError(message)


class _Topic(NamedTuple):
    name: str
    type: str
    qos: tuple[Qos, ...]
    definition: Definition | None


class _Message(NamedTuple):
    topic: str
    stamp_ns: int
    data: bytes


class Recording:
    """A bag that is being recorded.

    Attributes:
        failure: why recording ended by itself (the disk is full, ...), '' while it runs.
        written: messages given to the bag.
        overflow: messages given up because the disk did not keep pace.

    Raises:
        BagError: the bag cannot be created.
    """

    def __init__(self, options: RecorderOptions) -> None:
        single = options.bag.endswith('.mcap')
        self._writer = BagWriter(
            options.bag,
            compression=options.compression,
            split_bytes=0 if single else options.max_bag_size,
            split_ns=0 if single else round(options.max_bag_duration * 1e9),
            chunk_bytes=CHUNK_BYTES,
            crash_safe=True,
        )
        self.failure = ''
        self.written = 0
        self.overflow = 0
        self._waiting = 0
        self._lock = threading.Lock()
        self._queue: queue.SimpleQueue[_Topic | _Message | None] = queue.SimpleQueue()
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
        self._queue.put(_Topic(name, type, qos, definition))

    def write(self, topic: str, stamp_ns: int, data: bytes) -> bool:
        """Take a serialised message; False where it was given up."""
        with self._lock:
            if self.failure or self._waiting + len(data) > QUEUE_BYTES:
                self.overflow += not self.failure
                return False
            self._waiting += len(data)
        self._queue.put(_Message(topic, stamp_ns, data))
        return True

    def close(self) -> None:
        """Write what is waiting and finish the bag."""
        self._queue.put(None)
        self._thread.join()

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
        flush_at = time.monotonic() + FLUSH_PERIOD
        while True:
            remaining = flush_at - time.monotonic()
            if remaining <= 0:
                self._writer.flush()
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
                continue
            with self._lock:
                self._waiting -= len(item.data)
            self._writer.write(item.topic, item.stamp_ns, item.data)
            self.written += 1
