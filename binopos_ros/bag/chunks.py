"""The messages inside a chunk: decompression, splitting, and what can be saved of a torn one."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from mcap.opcode import Opcode

from binopos_ros.bag.errors import BagError

#: Opcode and length, which every record begins with.
RECORD_HEAD = struct.Struct('<BQ')
_MESSAGE_HEAD = struct.Struct('<HIQQ')


class RawMessage(NamedTuple):
    """One message as the file holds it."""

    channel_id: int
    log_time: int  #: ns
    publish_time: int  #: ns
    data: bytes


def decompress(data: memoryview, compression: str, size: int, crc: int) -> memoryview:
    """A whole chunk's records.

    Raises:
        BagError: compression unknown, or the bytes are damaged.
    """
    if compression == '':
        records = data
    elif compression == 'zstd':
        import zstandard

        try:
            decompressor = zstandard.ZstdDecompressor()
            records = memoryview(decompressor.decompress(data, max_output_size=size))
        except (zstandard.ZstdError, MemoryError) as error:
            message = f'zstd chunk is damaged: {error}'
            raise BagError(message) from error
    elif compression == 'lz4':
        import lz4.frame

        try:
            records = memoryview(lz4.frame.decompress(data))
        except RuntimeError as error:
            message = f'lz4 chunk is damaged: {error}'
            raise BagError(message) from error
    else:
        message = f"chunk compression '{compression}' is unknown (known: zstd, lz4, none)"
        raise BagError(message)
    if len(records) != size or (crc and zlib.crc32(records) != crc):
        message = 'chunk is damaged: its checksum or size does not match'
        raise BagError(message)
    return records


def salvage(data: memoryview, compression: str) -> memoryview:
    """As many of a torn chunk's records as its first bytes give; the last may be cut."""
    if compression == 'zstd':
        import zstandard

        try:
            return memoryview(zstandard.ZstdDecompressor().decompressobj().decompress(data))
        except zstandard.ZstdError:
            return memoryview(b'')
    if compression == 'lz4':
        import lz4.frame

        try:
            return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(data))
        except RuntimeError:
            return memoryview(b'')
    return data if compression == '' else memoryview(b'')


def split_records(records: memoryview) -> Iterator[tuple[int, int, int]]:
    """(opcode, start of the content, its end) of each complete record.

    Messages too short for their own fields are left out.
    """
    position, end = 0, len(records)
    while position + RECORD_HEAD.size <= end:
        opcode, length = RECORD_HEAD.unpack_from(records, position)
        start = position + RECORD_HEAD.size
        position = start + length
        if position > end:
            return
        if opcode != Opcode.MESSAGE or length >= _MESSAGE_HEAD.size:
            yield opcode, start, position


def message_at(records: memoryview, start: int, end: int) -> RawMessage:
    """The message whose record content is `records[start:end]`."""
    channel_id, _, log_time, publish_time = _MESSAGE_HEAD.unpack_from(records, start)
    return RawMessage(
        channel_id, log_time, publish_time, bytes(records[start + _MESSAGE_HEAD.size : end])
    )
