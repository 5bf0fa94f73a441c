"""Reading a bag message by message, in the order of their times, in memory that stays the same.

with BagReader('bags/washbowl') as reader:
    for record in reader.messages(topics=['/stereo/left/image_raw/compressed']):
        message = reader.decode(record)
"""

from __future__ import annotations

import heapq
import logging
import shutil
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from binopos_ros.bag.chunks import RawMessage
from binopos_ros.bag.definitions import Definition, full_name, store_for
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.index import FileIndex, Span, index_file, read_span
from binopos_ros.bag.layout import find_layout
from binopos_ros.bag.qos import Qos, parse_qos

_log = logging.getLogger('binopos.bag')


class Record(NamedTuple):
    """One message, still serialised."""

    topic: str
    stamp_ns: int  #: log time: when it was recorded
    data: bytes  #: CDR, its 4-byte encapsulation header included
    publish_ns: int  #: when it was published; the log time where the recorder did not know


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
        layout = find_layout(self.path)
        self._zstd_messages = layout.zstd_messages
        try:
            self._files = self._index(layout.files)
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
        time are in memory at once.
        """
        wanted = None if topics is None else set(topics)
        spans = self._spans(wanted, start_ns)
        pending: list[tuple[int, int, int, int, RawMessage]] = []
        for span, file_number in spans:
            while pending and pending[0][0] < span.start_ns:
                yield self._record(heapq.heappop(pending))
            channels = self._files[file_number].channels
            for position, message in enumerate(self._load(file_number, span)):
                channel = channels.get(message.channel_id)
                if (
                    channel is not None
                    and (wanted is None or channel.topic in wanted)
                    and (start_ns is None or message.log_time >= start_ns)
                ):
                    key = (message.log_time, file_number, span.offset, position)
                    heapq.heappush(pending, (*key, message))
        while pending:
            yield self._record(heapq.heappop(pending))

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
        import zstandard

        if self._temporary is None:
            self._temporary = tempfile.TemporaryDirectory(prefix='binopos_bag_')
        unpacked = Path(self._temporary.name) / file.stem
        try:
            with file.open('rb') as packed, unpacked.open('wb') as target:
                shutil.copyfileobj(zstandard.ZstdDecompressor().stream_reader(packed), target)
        except zstandard.ZstdError as error:
            message = f'{file}: not a zstd file, or damaged: {error}'
            raise BagError(message) from error
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

    def _load(self, file_number: int, span: Span) -> list[RawMessage]:
        path = self._files[file_number].path
        try:
            return read_span(path, span)
        except BagError as error:
            self._warn(f'{path}: {error}; the chunk at byte {span.offset} is left out')
            return []

    def _record(self, item: tuple[int, int, int, int, RawMessage]) -> Record:
        _, file_number, _, _, message = item
        topic = self._files[file_number].channels[message.channel_id].topic
        data = message.data
        if self._zstd_messages:
            import zstandard

            try:
                data = zstandard.ZstdDecompressor().decompress(data)
            except zstandard.ZstdError as error:
                reason = f'{self.path}: topic {topic}: message at {message.log_time} ns: {error}'
                raise BagError(reason) from error
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
