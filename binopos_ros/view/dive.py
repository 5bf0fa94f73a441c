"""The bags of one dive as one: what was recorded, and what was made of it afterwards."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

from binopos_ros.bag import BagError, BagReader, Record
from binopos_ros.bag.rig_topics import RigTopics
from binopos_ros.detection import DetectionError
from binopos_ros.sides import SIDES
from binopos_ros.view.encoding import encoded_picture
from binopos_ros.view.errors import ViewError
from binopos_ros.view.screen import DIAGNOSTICS, TOPICS
from binopos_ros.view.wire import Picture, serialized_picture

POSE = 'target/pose'


class Item(NamedTuple):
    """One message of a dive, still serialised."""

    stamp: int  #: ns; when it was recorded
    name: str  #: relative to the suite's namespace, or `PICTURES[side]`
    record: Record
    bag: int  #: which of the bags it is in


#: Names of the pictures, whatever their topics are called.
PICTURES = {side: f'{side}/picture' for side in SIDES}


class Dive:
    """Several bags merged by time; of a topic that several hold, the first bag's counts.

    Args:
        paths: of the bags.

    Attributes:
        start, end: ns, of the first and the last message that is shown.
        dropped: pictures and messages that could not be read.

    Raises:
        BagError: a bag cannot be read.
        ViewError: none holds anything to show.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = list(paths)
        self.dropped = 0
        self._open = ExitStack()
        self._readers: list[BagReader] = []
        self._topics: list[dict[str, str]] = []
        taken: set[str] = set()
        try:
            for path in paths:
                reader = self._open.enter_context(BagReader(path))
                found = {t: n for t, n in _names(reader).items() if n not in taken}
                taken |= set(found.values())
                self._readers.append(reader)
                self._topics.append(found)
        except BaseException:
            self.close()
            raise
        spans = [
            (reader.start_ns, reader.end_ns)
            for reader, topics in zip(self._readers, self._topics, strict=True)
            if topics
        ]
        if not spans:
            self.close()
            names = ', '.join(map(str, paths))
            msg = (
                f"{names}: neither the suite's topics nor pictures of a rig: give a bag with them"
            )
            raise ViewError(msg)
        self.start, self.end = min(s for s, _ in spans), max(e for _, e in spans)
        self.names = taken

    def __enter__(self) -> Dive:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the bags."""
        self._open.close()

    def items(
        self, start: int | None = None, names: Collection[str] | None = None
    ) -> Iterator[Item]:
        """Messages from a time on, ns, by time; only of `names`, or all."""
        return heapq.merge(
            *(self._of(number, start, names) for number in range(len(self._readers))),
            key=lambda item: item.stamp,
        )

    def picture(self, item: Item) -> Picture | None:
        """The picture of an item; None where it cannot be read, which is counted."""
        side = item.name.partition('/')[0]
        reader = self._readers[item.bag]
        try:
            if reader.topics[item.record.topic].type.endswith('CompressedImage'):
                return serialized_picture(side, item.record.data)
            return encoded_picture(side, reader.decode(item.record))
        except (ViewError, BagError, DetectionError):
            self.dropped += 1
            return None

    def message(self, item: Item) -> Any | None:
        """The message of an item; None where it cannot be read, which is counted."""
        try:
            return self._readers[item.bag].decode(item.record)
        except BagError:
            self.dropped += 1
            return None

    def _of(self, number: int, start: int | None, names: Collection[str] | None) -> Iterator[Item]:
        topics = self._topics[number]
        wanted = [topic for topic, name in topics.items() if names is None or name in names]
        if not wanted:
            return
        for record in self._readers[number].messages(wanted, start):
            yield Item(record.stamp_ns, topics[record.topic], record, number)


def _names(reader: BagReader) -> dict[str, str]:
    """The topics of a bag that are shown -> the names they are shown under."""
    held = {topic: info.type for topic, info in reader.topics.items() if info.count}
    found = {}
    for topic, kind in held.items():
        for name, wanted in TOPICS.items():
            if kind == wanted and (topic == name or topic.endswith(f'/{name}')):
                found[topic] = name
    if DIAGNOSTICS in held:
        found[DIAGNOSTICS] = DIAGNOSTICS
    try:
        rig = RigTopics.find(reader, calibrated=True)
    except BagError:
        return found
    for topic, role in rig.roles.items():
        if role.is_image and role.side in PICTURES:
            found[topic] = PICTURES[role.side]
    return found
