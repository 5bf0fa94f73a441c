"""Where the messages of one MCAP file lie: by its summary, or by a scan where it has none.

A whole file ends with a summary (chunk index, channels, schemas, statistics). A file whose writer
was killed, or whose disk filled, has none or a torn one; then its records are walked from the
start. The walk jumps over the chunks' contents, so it costs little even on a long recording.

The format: https://mcap.dev/spec
"""

from __future__ import annotations

import io
import logging
import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, ChunkIndex, Schema
from mcap.summary import Summary

from binopos_ros.bag.chunks import (
    LARGEST,
    RECORD_HEAD,
    RawMessage,
    decompress,
    message_at,
    refuse_too_large,
    salvage,
    split_records,
)
from binopos_ros.bag.errors import BagError

MAGIC = b'\x89MCAP0\r\n'
#: Of a chunk: first and last time, size, checksum, length of the compression's name.
CHUNK_HEAD = struct.Struct('<QQQII')

#: A run of messages outside chunks is read in stretches of about this many bytes.
_LOOSE_SPAN_BYTES = 1 << 20
#: Of a summary, or a schema or channel anywhere; the longest are the definitions of messages.
LARGEST_SUMMARY_RECORD = 16 << 20
_FOOTER = struct.Struct('<BQQQI')  # head, start of the summary and of its offsets, checksum
_CRC_BYTES = 4
_MESSAGE_INDEX_HEAD = struct.Struct('<HI')  # channel, bytes of its entries
_MESSAGE_TIMES = struct.Struct('<HIQ')  # channel, sequence, log time

_log = logging.getLogger('binopos.bag')


@dataclass
class Span:
    """A stretch of the file that is read in one go: a chunk, or a run of loose messages."""

    start_ns: int
    end_ns: int
    offset: int  #: of the first record's head
    length: int  #: bytes, heads included
    kind: str  #: 'chunk', 'torn' (a chunk cut off by the end of the file) or 'loose'
    channel_ids: frozenset[int] | None = None  #: None where unknown


@dataclass
class FileIndex:
    """What one file holds; times in nanoseconds."""

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    spans: list[Span] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    damage: str = ''  #: what is lost, '' for a whole file

    @property
    def start_ns(self) -> int | None:
        """Time of the first message."""
        return min((span.start_ns for span in self.spans), default=None)

    @property
    def end_ns(self) -> int | None:
        """Time of the last message."""
        return max((span.end_ns for span in self.spans), default=None)


def index_file(path: Path, *, name: str | None = None) -> FileIndex:
    """Index of an MCAP file, whole or truncated.

    `name` is what messages call the file, where `path` is a temporary copy.

    Raises:
        BagError: empty, or no MCAP file.
    """
    name = name or str(path)
    with path.open('rb') as stream:
        size = os.fstat(stream.fileno()).st_size
        if size == 0:
            message = f'{name}: file is empty: nothing was recorded, or the disk was full'
            raise BagError(message)
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            message = (
                f'{name}: not an MCAP file (it begins with {magic!r}): '
                'give a bag of rosbag2 (.mcap, .db3) or of ROS 1 (.bag)'
            )
            raise BagError(message)
        stream.seek(-min(size, len(MAGIC)), os.SEEK_END)
        has_footer = stream.read() == MAGIC and size > len(MAGIC)
        summary = _read_summary(stream, size) if has_footer else None
        if summary is not None:
            return _from_summary(path, summary)
        return _Scan(path, stream, size, has_footer=has_footer).run()


def read_span(path: Path, span: Span) -> memoryview:
    """The records of a span.

    Raises:
        BagError: its bytes are damaged, or too many.
    """
    refuse_too_large(span.length, 'a record')
    with path.open('rb') as stream:
        stream.seek(span.offset)
        data = memoryview(stream.read(span.length))
    return data if span.kind == 'loose' else _chunk_records(data, torn=span.kind == 'torn')


def messages_in(records: memoryview) -> Iterator[RawMessage]:
    """All messages of a span's records in the file's order."""
    return (
        message_at(records, start, end)
        for opcode, start, end in split_records(records)
        if opcode == Opcode.MESSAGE
    )


def _chunk_records(data: memoryview, *, torn: bool) -> memoryview:
    """Records inside a chunk record (its head included)."""
    start = RECORD_HEAD.size
    if len(data) < start + CHUNK_HEAD.size:
        return memoryview(b'')
    _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(data, start)
    start += CHUNK_HEAD.size
    compression = bytes(data[start : start + name_length]).decode('ascii', 'replace')
    start += name_length + 8
    content = data[start:]
    if torn:
        return salvage(content, compression, size)
    return decompress(content, compression, size, crc)


def _read_summary(stream: BinaryIO, size: int) -> Summary | None:
    """The summary, or None where it is missing, torn or too poor to read by."""
    stream.seek(0)
    try:
        if not _summary_is_intact(stream, size):
            return None
        stream.seek(0)
        summary = SeekingReader(stream, record_size_limit=LARGEST_SUMMARY_RECORD).get_summary()
    except (McapError, struct.error, ValueError, OSError, OverflowError, MemoryError):
        return None
    if summary is None or summary.statistics is None:
        return None
    statistics = summary.statistics
    known = all(
        channel.schema_id == 0 or channel.schema_id in summary.schemas
        for channel in summary.channels.values()
    )
    complete = (
        known
        and len(summary.chunk_indexes) == statistics.chunk_count
        and summary.channels.keys() >= statistics.channel_message_counts.keys()
        and (summary.chunk_indexes or statistics.message_count == 0)
        and all(
            index.chunk_start_offset + index.chunk_length <= size
            for index in summary.chunk_indexes
        )
    )
    return summary if complete else None


def _summary_is_intact(stream: BinaryIO, size: int) -> bool:
    stream.seek(size - len(MAGIC) - _FOOTER.size)
    opcode, length, start, _, crc = _FOOTER.unpack(stream.read(_FOOTER.size))
    end = size - len(MAGIC) - _CRC_BYTES
    whole = opcode == Opcode.FOOTER and length == _FOOTER.size - RECORD_HEAD.size
    if not (whole and 0 < start <= end):
        return False
    stream.seek(start)
    found = 0
    while crc and (left := end - stream.tell()) > 0:
        found = zlib.crc32(stream.read(min(left, _LOOSE_SPAN_BYTES)), found)
    return crc == found


def _from_summary(path: Path, summary: Summary) -> FileIndex:
    assert summary.statistics is not None
    return FileIndex(
        path=path,
        channels=dict(summary.channels),
        schemas=dict(summary.schemas),
        spans=[_span_of(index) for index in summary.chunk_indexes],
        counts=Counter(summary.statistics.channel_message_counts),
    )


def _span_of(index: ChunkIndex) -> Span:
    return Span(
        index.message_start_time,
        index.message_end_time,
        index.chunk_start_offset,
        index.chunk_length,
        'chunk',
        frozenset(index.message_index_offsets) or None,
    )


class _Scan:
    """A walk over the records of a file without a usable summary.

    `has_footer`: the file ends as a whole one does. If its summary is damaged, then a writer was
    killed while it replaced the summary by a chunk, and what follows that chunk's beginning may
    be the old summary.
    """

    def __init__(self, path: Path, stream: BinaryIO, size: int, *, has_footer: bool) -> None:
        self.has_footer = has_footer
        self.index = FileIndex(path)
        self.stream = stream
        self.size = size
        self.loose: Span | None = None
        self.chunk: Span | None = None  # whose message indexes are being read
        self.chunk_counts: Counter[int] = Counter()  # from those message indexes
        self.saved = 0  # messages out of a torn chunk

    def run(self) -> FileIndex:
        position = len(MAGIC)
        ended = False
        while position < self.size and not ended:
            self.stream.seek(position)
            head = self.stream.read(RECORD_HEAD.size)
            if len(head) < RECORD_HEAD.size:
                break
            opcode, length = RECORD_HEAD.unpack(head)
            end = position + RECORD_HEAD.size + length
            if opcode == 0 or end > self.size:
                if opcode == Opcode.CHUNK and not self.has_footer:
                    self._torn_chunk(position)
                break
            try:
                self._record(opcode, position, end)
            except (struct.error, BagError):
                break
            # After the data section comes only what the summary would have said.
            ended = opcode in (Opcode.DATA_END, Opcode.FOOTER)
            position = end
        if not ended and self.chunk is not None:
            # Some of its message indexes may be cut off.
            self.chunk.channel_ids = None
        self._finish_chunk()
        self._finish_loose()
        if not ended:
            lost = self.size - position
            self.index.damage = f'it is cut off in a record, {lost} bytes before its end'
            if lost == 0:
                self.index.damage = 'it ends without an index'
            elif self.saved:
                self.index.damage += f', {self.saved} messages of which were saved'
        return self.index

    def _record(self, opcode: int, position: int, end: int) -> None:
        if opcode != Opcode.MESSAGE_INDEX:
            self._finish_chunk()
        self.stream.seek(position + RECORD_HEAD.size)
        if opcode == Opcode.CHUNK:
            start_ns, end_ns, *_ = CHUNK_HEAD.unpack(self.stream.read(CHUNK_HEAD.size))
            self.chunk = Span(start_ns, end_ns, position, end - position, 'chunk')
        elif opcode == Opcode.MESSAGE_INDEX and self.chunk is not None:
            channel_id, entries = _MESSAGE_INDEX_HEAD.unpack(
                self.stream.read(_MESSAGE_INDEX_HEAD.size)
            )
            self.chunk.channel_ids = (self.chunk.channel_ids or frozenset()) | {channel_id}
            self.chunk_counts[channel_id] += entries // 16
        elif opcode == Opcode.MESSAGE:
            channel_id, _, log_time = _MESSAGE_TIMES.unpack(self.stream.read(_MESSAGE_TIMES.size))
            self.index.counts[channel_id] += 1
            self._extend_loose(position, end, log_time)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            length = end - position - RECORD_HEAD.size
            if length > LARGEST_SUMMARY_RECORD:
                message = f'a schema or channel record of {length} bytes is damaged'
                raise BagError(message)
            self._declare(opcode, self.stream.read(length))

    def _declare(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(content))
        try:
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                self.index.schemas.setdefault(schema.id, schema)
            else:
                channel = Channel.read(stream)
                self.index.channels.setdefault(channel.id, channel)
        except (struct.error, McapError, UnicodeDecodeError) as error:
            message = 'a schema or channel record is damaged'
            raise BagError(message) from error

    def _extend_loose(self, position: int, end: int, log_time: int) -> None:
        span = self.loose
        if span is not None and (
            span.offset + span.length != position or span.length > _LOOSE_SPAN_BYTES
        ):
            self._finish_loose()
            span = None
        if span is None:
            self.loose = Span(log_time, log_time, position, end - position, 'loose')
        else:
            span.start_ns = min(span.start_ns, log_time)
            span.end_ns = max(span.end_ns, log_time)
            span.length = end - span.offset

    def _finish_loose(self) -> None:
        if self.loose is not None:
            self.index.spans.append(self.loose)
            self.loose = None

    def _finish_chunk(self) -> None:
        """Take the chunk up, opening it only where its message indexes leave something open."""
        span, self.chunk = self.chunk, None
        counts, self.chunk_counts = self.chunk_counts, Counter()
        if span is None:
            return
        if span.channel_ids is not None:
            self.index.counts.update(counts)
        if span.channel_ids is None or span.channel_ids - self.index.channels.keys():
            try:
                records = read_span(self.index.path, span)
                self._look_into(records, span, count=span.channel_ids is None)
            except BagError as error:
                _log.warning('%s: %s; the chunk is left out', self.index.path, error)
                return
        self.index.spans.append(span)

    def _torn_chunk(self, position: int) -> None:
        self._finish_chunk()
        length = min(self.size - position, LARGEST)
        span = Span(0, 0, position, length, 'torn')
        self.saved = self._look_into(read_span(self.index.path, span), span, count=True)
        if self.saved:
            self.index.spans.append(span)

    def _look_into(self, records: memoryview, span: Span, *, count: bool) -> int:
        """Learn a chunk's channels, and if asked its times; the number of messages counted."""
        times: list[int] = []
        for opcode, start, end in split_records(records):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._declare(opcode, bytes(records[start:end]))
            elif opcode == Opcode.MESSAGE and count:
                channel_id, _, log_time = _MESSAGE_TIMES.unpack_from(records, start)
                self.index.counts[channel_id] += 1
                times.append(log_time)
        if times:
            span.start_ns, span.end_ns = min(times), max(times)
        return len(times)
