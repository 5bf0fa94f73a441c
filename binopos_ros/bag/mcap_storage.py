"""The MCAP files of a bag: their messages in the order of time, in memory that stays the same."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from binopos_ros.bag.chunks import ChunkStore, RawMessage
from binopos_ros.bag.definitions import Definition, full_name
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.index import FileIndex, Span, index_file, messages_in, read_span
from binopos_ros.bag.qos import parse_qos
from binopos_ros.bag.records import Record, TopicInfo

#: Messages that may wait for their turn, each some 500 bytes beside its data.
MOST_PENDING = 1 << 20


class _Pending(NamedTuple):
    """A message that waits for its turn: by its time, equal ones as they stand in the files."""

    log_time: int
    file_number: int
    offset: int
    start: int
    span: Span
    message: RawMessage


class McapStorage:
    """The files of a bag in MCAP.

    Args:
        paths: the files.
        names: what messages call them, where a path is a temporary copy.
        warn: is told what is wrong with them, a line each.

    Raises:
        BagError: no file can be read.
    """

    def __init__(
        self, paths: Collection[Path], names: Collection[Path], warn: Callable[[str], None]
    ) -> None:
        self._warn = warn
        self._chunks = ChunkStore()
        self._left_out: set[tuple[int, int]] = set()
        self._files = self._index(paths, names)
        self.topics = _topics(self._files)
        self.start_ns = min((i.start_ns for i in self._files if i.start_ns is not None), default=0)
        self.end_ns = max((i.end_ns for i in self._files if i.end_ns is not None), default=0)

    def messages(self, wanted: Collection[str] | None, start_ns: int | None) -> Iterator[Record]:
        """Messages in the order of their log time, equal ones as in the files; None: all.

        Only the chunks that overlap in time are in memory at once, and no more of them than
        `ChunkStore` holds.
        """
        topics = None if wanted is None else set(wanted)
        pending: list[_Pending] = []
        try:
            for span, file_number in self._spans(topics, start_ns):
                while pending and pending[0].log_time < span.start_ns:
                    yield self._record(heapq.heappop(pending))
                self._take_up(pending, span, file_number, topics, start_ns)
            while pending:
                yield self._record(heapq.heappop(pending))
        finally:
            for waiting in pending:
                self._chunks.release((waiting.file_number, waiting.offset))

    def close(self) -> None:
        """Nothing stays open."""

    def _take_up(
        self,
        pending: list[_Pending],
        span: Span,
        file_number: int,
        wanted: set[str] | None,
        start_ns: int | None,
    ) -> None:
        """Let the wanted messages of a span wait for their turn."""
        channels = self._files[file_number].channels
        key = (file_number, span.offset)
        for message in messages_in(self._load(file_number, span)):
            channel = channels.get(message.channel_id)
            if (
                channel is not None
                and (wanted is None or channel.topic in wanted)
                and (start_ns is None or message.log_time >= start_ns)
            ):
                place = (message.log_time, file_number, span.offset, message.start)
                heapq.heappush(pending, _Pending(*place, span, message))
                self._chunks.hold(key)
        self._chunks.drop_unheld(key)
        if len(pending) > MOST_PENDING:
            path = self._files[file_number].path
            error = (
                f'{path}: more than {MOST_PENDING} messages overlap in time: put them in order '
                'with `mcap sort`'
            )
            raise BagError(error)

    def _index(self, paths: Collection[Path], names: Collection[Path]) -> list[FileIndex]:
        indexes: list[FileIndex] = []
        problems: list[BagError] = []
        for path, file in zip(paths, names, strict=True):
            try:
                index = index_file(path, name=str(file))
            except BagError as error:
                problems.append(error)
                continue
            indexes.append(index)
            if index.damage:
                count = index.counts.total()
                self._warn(f'{file}: {index.damage}; its first {count} messages are read')
        if not indexes:
            raise problems[0]
        for problem in problems:
            self._warn(f'{problem}; this part of the bag is left out')
        return indexes

    def _spans(self, wanted: set[str] | None, start_ns: int | None) -> list[tuple[Span, int]]:
        """Spans that may hold wanted messages, in the order in which they must be loaded."""
        spans: list[tuple[Span, int]] = []
        for number, file in enumerate(self._files):
            ids = {
                channel.id
                for channel in file.channels.values()
                if wanted is None or channel.topic in wanted
            }
            spans += [
                (span, number)
                for span in file.spans
                if (start_ns is None or span.end_ns >= start_ns)
                and (span.channel_ids is None or span.channel_ids & ids)
            ]
        return sorted(spans, key=lambda item: (item[0].start_ns, item[1], item[0].offset))

    def _load(self, file_number: int, span: Span) -> memoryview:
        key = (file_number, span.offset)
        records = self._chunks.get(key)
        if records is None:
            path = self._files[file_number].path
            try:
                records = read_span(path, span)
            except BagError as error:
                records = memoryview(b'')
                if key not in self._left_out:
                    self._left_out.add(key)
                    self._warn(f'{path}: {error}; the chunk at byte {span.offset} is left out')
            self._chunks.put(key, records)
        return records

    def _record(self, pending: _Pending) -> Record:
        message = pending.message
        topic = self._files[pending.file_number].channels[message.channel_id].topic
        records = self._load(pending.file_number, pending.span)
        data = bytes(records[message.start : message.end])
        self._chunks.release((pending.file_number, pending.offset))
        return Record(topic, message.log_time, data)


def _topics(files: list[FileIndex]) -> dict[str, TopicInfo]:
    topics: dict[str, TopicInfo] = {}
    for file in files:
        for channel in file.channels.values():
            count = file.counts[channel.id]
            if channel.topic in topics:
                topics[channel.topic].count += count
                continue
            schema = file.schemas.get(channel.schema_id)
            definition = Definition(
                schema.encoding if schema else '',
                schema.data.decode('utf-8', 'replace') if schema else '',
                channel.metadata.get('topic_type_hash', ''),
            )
            topics[channel.topic] = TopicInfo(
                type=full_name(schema.name) if schema else '',
                count=count,
                encoding=channel.message_encoding,
                definition=definition,
                qos=parse_qos(channel.metadata.get('offered_qos_profiles', '')),
            )
    return topics
