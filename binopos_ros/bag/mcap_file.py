"""Writing one MCAP file, so that it can be whole after every chunk.

A file's summary lies at its end. With `always_whole`, every chunk is followed by a summary and a
footer, which the next chunk overwrites: a writer that is killed leaves a file that every reader
opens. Without it the summary comes once, at the end, and a killed writer leaves a file that has to
be scanned (see `index.py`).

The format: https://mcap.dev/spec
"""

from __future__ import annotations

import contextlib
import errno
import os
import struct
import zlib
from dataclasses import dataclass, field
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from binopos_ros.bag.chunks import RECORD_HEAD
from binopos_ros.bag.errors import BagError
from binopos_ros.bag.index import CHUNK_HEAD, MAGIC

COMPRESSIONS = ('none', 'zstd', 'lz4')

_MESSAGE = struct.Struct('<BQHIQQ')  # opcode, length, channel, sequence, log time, publish time
_MESSAGE_FIELDS = 22  # bytes of a message record before its data
_DATA_LENGTH = struct.Struct('<Q')
_FOOTER_CRC = struct.Struct('<BQQQ')


@dataclass
class _Pending:
    """Records that wait for their chunk."""

    records: list[bytes] = field(default_factory=list)
    size: int = 0
    count: int = 0
    start_ns: int = 0
    end_ns: int = 0
    index: dict[int, MessageIndex] = field(default_factory=dict)

    def add(self, *data: bytes) -> None:
        self.records += data
        self.size += sum(map(len, data))


@dataclass(frozen=True)
class _Written:
    """What is safe on the disk."""

    end: int = 0  #: of the data section; what follows is a summary
    index_end: int = 0  #: bytes of the chunk indexes that belong to it
    chunks: int = 0
    messages: int = 0
    start_ns: int = 0
    end_ns: int = 0
    counts: dict[int, int] = field(default_factory=dict)


class McapFile:
    """One MCAP file, written chunk by chunk.

    Args:
        path: must not exist yet.
        library: the writer's name, for the header.
        compression: of the chunks, one of COMPRESSIONS.
        chunk_bytes: a chunk is written once its messages take more than this.
        always_whole: follow every chunk by a summary.

    Raises:
        BagError: the file exists or cannot be created, or (any method) cannot be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        library: str,
        compression: str,
        chunk_bytes: int,
        always_whole: bool,
    ) -> None:
        if compression not in COMPRESSIONS:
            message = f"compression '{compression}' is unknown: one of {', '.join(COMPRESSIONS)}"
            raise BagError(message)
        self.path = path
        self._compression = '' if compression == 'none' else compression
        self._chunk_bytes = chunk_bytes
        self._always_whole = always_whole
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._chunk_indexes = bytearray()
        self._pending = _Pending()
        self._written = _Written()
        self._whole = False
        try:
            self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError as error:
            message = f'{path} exists already: choose another name, or remove it'
            raise BagError(message) from error
        except OSError as error:
            message = f'{path} cannot be created: {error.strerror}'
            raise BagError(message) from error
        try:
            head = MAGIC + _bytes_of(Header('ros2', library))
            self._commit([head], _Written(end=len(head)))
        except BagError:
            os.close(self._descriptor)
            raise

    @property
    def message_count(self) -> int:
        """Messages taken so far, on disk or not."""
        return self._written.messages + self._pending.count

    @property
    def times_ns(self) -> tuple[int, int] | None:
        """Log times of the earliest and the latest message, None before the first."""
        times = [
            (part.start_ns, part.end_ns)
            for part, count in (
                (self._written, self._written.messages),
                (self._pending, self._pending.count),
            )
            if count
        ]
        if not times:
            return None
        return min(start for start, _ in times), max(end for _, end in times)

    @property
    def size(self) -> int:
        """Bytes of the chunks on disk and of the pending messages."""
        return self._written.end + self._pending.size

    def count(self, channel_id: int) -> int:
        """Messages of a channel, on disk or not."""
        index = self._pending.index.get(channel_id)
        return self._written.counts.get(channel_id, 0) + (len(index.records) if index else 0)

    def add_schema(self, name: str, encoding: str, text: str) -> int:
        """Register a schema; its number."""
        schema = Schema(
            id=len(self._schemas) + 1, data=text.encode(), encoding=encoding, name=name
        )
        self._declare(schema, self._schemas)
        return schema.id

    def add_channel(self, topic: str, schema_id: int, metadata: dict[str, str]) -> int:
        """Register a topic; its number."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding='cdr',
            metadata=metadata,
            schema_id=schema_id,
        )
        self._declare(channel, self._channels)
        return channel.id

    def add_message(self, channel_id: int, log_ns: int, data: bytes) -> None:
        """Take a message, published when it is logged; it is on disk after the next `flush`."""
        pending = self._pending
        sequence = self.count(channel_id)
        index = pending.index.get(channel_id)
        if index is None:
            index = pending.index[channel_id] = MessageIndex(channel_id, [])
        index.records.append((log_ns, pending.size))
        length = _MESSAGE_FIELDS + len(data)
        pending.add(
            _MESSAGE.pack(Opcode.MESSAGE, length, channel_id, sequence, log_ns, log_ns), data
        )
        pending.start_ns = min(log_ns, pending.start_ns) if pending.count else log_ns
        pending.end_ns = max(log_ns, pending.end_ns)
        pending.count += 1
        if pending.size > self._chunk_bytes:
            self.flush()

    def flush(self) -> None:
        """Bring all messages to the disk; the file is whole afterwards if `always_whole`."""
        pending = self._pending
        if not pending.count:
            return
        # A chunk that cannot be written is given up: its messages would only pile up.
        self._pending = _Pending()
        written = self._written
        block = self._chunk_block(pending)
        counts = dict(written.counts)
        for channel_id, index in pending.index.items():
            counts[channel_id] = counts.get(channel_id, 0) + len(index.records)
        self._commit(
            block,
            _Written(
                end=written.end + sum(map(len, block)),
                index_end=len(self._chunk_indexes),
                chunks=written.chunks + 1,
                messages=written.messages + pending.count,
                start_ns=(
                    min(written.start_ns, pending.start_ns)
                    if written.messages
                    else pending.start_ns
                ),
                end_ns=max(written.end_ns, pending.end_ns),
                counts=counts,
            ),
        )

    def close(self) -> None:
        """Write what is pending, then the summary."""
        try:
            self.flush()
            if not self._whole:
                self._always_whole = True
                self._commit([], self._written)
        finally:
            os.close(self._descriptor)

    def _declare(self, record: Schema | Channel, declared: list[bytes]) -> None:
        declared.append(_bytes_of(record))
        self._pending.add(declared[-1])
        self._whole = False

    def _chunk_block(self, pending: _Pending) -> list[bytes]:
        """The chunk with its message indexes; its chunk index is kept for the summary."""
        records = b''.join(pending.records)
        data = _compress(records, self._compression)
        name = self._compression.encode()
        fields = CHUNK_HEAD.pack(
            pending.start_ns, pending.end_ns, len(records), zlib.crc32(records), len(name)
        )
        content_length = len(fields) + len(name) + _DATA_LENGTH.size + len(data)
        head = b''.join(
            (
                RECORD_HEAD.pack(Opcode.CHUNK, content_length),
                fields,
                name,
                _DATA_LENGTH.pack(len(data)),
            )
        )
        chunk_length = len(head) + len(data)
        indexes = RecordBuilder()
        offsets: dict[int, int] = {}
        for channel_id, index in pending.index.items():
            offsets[channel_id] = self._written.end + chunk_length + indexes.count
            index.write(indexes)
        self._chunk_indexes += _bytes_of(
            ChunkIndex(
                chunk_length=chunk_length,
                chunk_start_offset=self._written.end,
                compression=self._compression,
                compressed_size=len(data),
                message_end_time=pending.end_ns,
                message_index_length=indexes.count,
                message_index_offsets=offsets,
                message_start_time=pending.start_ns,
                uncompressed_size=len(records),
            )
        )
        return [head, data, indexes.end()]

    def _commit(self, block: list[bytes], after: _Written) -> None:
        """Append a block in place of the old summary, so that `after` holds; or change nothing."""
        before = self._written
        self._written = after
        try:
            if not self._always_whole:
                # The summary that followed a full disk may be longer than what replaces it.
                os.ftruncate(self._descriptor, before.end)
            summary = [self._summary()] if self._always_whole else []
            self._write(before.end, [*block, *summary])
        except OSError as error:
            self._written = before
            del self._chunk_indexes[before.index_end :]
            # The old summary fitted before, so it fits again.
            with contextlib.suppress(OSError):
                os.ftruncate(self._descriptor, before.end)
                self._write(before.end, [self._summary()])
            self._whole = True
            lost = after.messages - before.messages
            full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
            reason = 'no space left for it' if full else error.strerror
            message = (
                f'{self.path} cannot be written: {reason}; '
                f'its {before.messages} messages so far stay readable, {lost} are lost'
            )
            raise BagError(message) from error
        self._whole = self._always_whole

    def _write(self, offset: int, parts: list[bytes]) -> None:
        # In one call: between two, a recorder that is killed would leave a file without summary.
        left = [memoryview(part) for part in parts]
        while left:
            count = os.pwritev(self._descriptor, left, offset)
            offset += count
            while left and count >= len(left[0]):
                count -= len(left.pop(0))
            if left:
                left[0] = left[0][count:]

    def _summary(self) -> bytes:
        """Everything that follows the data section."""
        written = self._written
        data_end = _bytes_of(DataEnd(0))
        start = written.end + len(data_end)
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=written.counts,
            chunk_count=written.chunks,
            message_count=written.messages,
            message_end_time=written.end_ns,
            message_start_time=written.start_ns,
            metadata_count=0,
            schema_count=len(self._schemas),
        )
        groups = (
            (Opcode.SCHEMA, b''.join(self._schemas)),
            (Opcode.CHANNEL, b''.join(self._channels)),
            (Opcode.STATISTICS, _bytes_of(statistics)),
            (Opcode.CHUNK_INDEX, bytes(self._chunk_indexes[: written.index_end])),
        )
        offsets = RecordBuilder()
        offset = start
        for opcode, data in groups:
            if data:
                SummaryOffset(opcode, offset, len(data)).write(offsets)
            offset += len(data)
        summary = b''.join(data for _, data in groups) + offsets.end()
        crc = zlib.crc32(_FOOTER_CRC.pack(Opcode.FOOTER, 20, start, offset), zlib.crc32(summary))
        return data_end + summary + _bytes_of(Footer(start, offset, crc)) + MAGIC


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _compress(records: bytes, compression: str) -> bytes:
    if compression == 'zstd':
        import zstandard

        return zstandard.ZstdCompressor(level=1).compress(records)
    if compression == 'lz4':
        import lz4.frame

        return lz4.frame.compress(records)
    return records
