"""Reading a bag message by message, in the order of their times, in memory that stays the same.

with BagReader('bags/washbowl') as reader:
    for record in reader.messages(topics=['/stereo/left/image_raw/compressed']):
        message = reader.decode(record)
"""

from __future__ import annotations

import heapq
import logging
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from binopos_ros.bag.chunks import LARGEST, ChunkStore, RawMessage, unpack_file, unpacked_zstd
from binopos_ros.bag.definitions import Definition, full_name, store_for
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.index import FileIndex, Span, index_file, messages_in, read_span
from binopos_ros.bag.layout import find_files
from binopos_ros.bag.qos import Qos, parse_qos

_log = logging.getLogger('binopos.bag')


#: Messages that may wait for their turn, each some 500 bytes beside its data.
MOST_PENDING = 1 << 20
#: What a file or a message compressed by zstd begins with; no CDR does.
_ZSTD = b'\x28\xb5\x2f\xfd'


class Record(NamedTuple):
    """One message, still serialised."""

    topic: str
    stamp_ns: int  #: log time: when it was recorded
    data: bytes  #: CDR, its 4-byte encapsulation header included
    publish_ns: int  #: when it was published; the log time where the recorder did not know


class _Pending(NamedTuple):
    """A message that waits for its turn: by its time, equal ones as they stand in the files."""

    log_time: int
    file_number: int
    offset: int
    start: int
    span: Span
    message: RawMessage


@dataclass
class TopicInfo:
    """What the bag says about a topic."""

    type: str  #: as `package/msg/Name`
    count: int  #: messages in the bag
    encoding: str  #: of the messages: 'cdr' in a bag of ROS 2
    definition: Definition
    qos: list[Qos] = field(default_factory=list)  #: what its publishers offered


class BagReader:
    """A bag opened for reading: folder or file, whole, split, compressed, or cut off.

    A bag that is damaged is read as far as it goes: what is lost is said in one line through the
    logger `binopos.bag`, and kept in `warnings`.

    Attributes:
        topics: by name, those without any message too.
        start_ns, end_ns: times of the first and the last message, 0 in a bag without messages.
        message_count: number of messages.
        warnings: what is wrong with the bag, a line each.

    Raises:
        BagError: missing, empty, not an MCAP bag.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.warnings: list[str] = []
        self._temporary: tempfile.TemporaryDirectory[str] | None = None
        self._stores: dict[str, Any] = {}
        self._chunks = ChunkStore()
        self._left_out: set[tuple[int, int]] = set()
        try:
            self._files = self._index(find_files(self.path))
        except BaseException:
            self.close()
            raise
        self.topics = _topics(self._files)
        self.message_count = sum(topic.count for topic in self.topics.values())
        self.start_ns = min((i.start_ns for i in self._files if i.start_ns is not None), default=0)
        self.end_ns = max((i.end_ns for i in self._files if i.end_ns is not None), default=0)

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Remove what was unpacked for reading."""
        if self._temporary is not None:
            self._temporary.cleanup()
            self._temporary = None

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None
    ) -> Iterator[Record]:
        """Messages in the order of their log time, from `start_ns` on; `topics` None: all.

        Messages of the same time come in the order of the file. Only the chunks that overlap in
        time are in memory at once, and no more of them than `ChunkStore` holds.

        Raises:
            BagError: more messages overlap in time than can wait, or one is damaged.
        """
        wanted = None if topics is None else set(topics)
        pending: list[_Pending] = []
        try:
            for span, file_number in self._spans(wanted, start_ns):
                while pending and pending[0].log_time < span.start_ns:
                    yield self._record(heapq.heappop(pending))
                self._take_up(pending, span, file_number, wanted, start_ns)
            while pending:
                yield self._record(heapq.heappop(pending))
        finally:
            for waiting in pending:
                self._chunks.release((waiting.file_number, waiting.span.offset))

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
            error = (
                f'{self.path}: more than {MOST_PENDING} of its messages overlap in time: put '
                'them in order with `mcap sort`'
            )
            raise BagError(error)

    def decode(self, record: Record) -> Any:
        """The message as `rosbags` builds it; arrays are views of the record's bytes.

        Raises:
            BagError: the encoding is not CDR, the definition unreadable, or the bytes damaged.
        """
        info = self.topics[record.topic]
        store = self._stores.get(record.topic)
        if store is None:
            if info.encoding != 'cdr':
                message = (
                    f"{self.path}: topic {record.topic} is encoded as '{info.encoding}', "
                    "which is unknown: only 'cdr' is read"
                )
                raise BagError(message)
            try:
                store = store_for(info.type, info.definition)
            except BagError as error:
                message = f'{self.path}: topic {record.topic}: {error}'
                raise BagError(message) from error
            self._stores[record.topic] = store
        try:
            return store.deserialize_cdr(record.data, info.type)
        except Exception as error:
            # rosbags generates its readers; damaged bytes surface as whatever they run into.
            message = (
                f'{self.path}: topic {record.topic}: message at {record.stamp_ns} ns '
                f'is no {info.type}: {" ".join(str(error).split())}'
            )
            raise BagError(message) from error

    def _index(self, files: tuple[Path, ...]) -> list[FileIndex]:
        indexes: list[FileIndex] = []
        problems: list[BagError] = []
        for file in files:
            try:
                index = index_file(self._unpacked(file), name=str(file))
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

    def _unpacked(self, file: Path) -> Path:
        if file.suffix != '.zstd':
            return file
        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix='binopos_bag_')
        unpacked = Path(self._temporary.name) / file.stem
        unpack_file(file, unpacked)
        return unpacked

    def _warn(self, line: str) -> None:
        self.warnings.append(line)
        _log.warning('%s', line)

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
        if data.startswith(_ZSTD):
            try:
                data = bytes(unpacked_zstd(data, LARGEST, 'message'))
            except BagError as error:
                # As it stands it is refused by who decodes it, and costs only itself.
                self._warn(f'{self.path}: topic {topic}: at {message.log_time} ns: {error}')
        return Record(topic, message.log_time, data, message.publish_time)


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
