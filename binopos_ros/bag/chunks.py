"""The messages inside a chunk: decompression, splitting, and what can be saved of a torn one."""

from __future__ import annotations

import shutil
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode

from binopos_ros.bag.errors import BagError

#: Opcode and length, which every record begins with.
RECORD_HEAD = struct.Struct('<BQ')
#: The most that is unpacked at a time, bytes: twice the largest picture that is looked at.
LARGEST = 256 << 20
#: Bytes that a byte of a compressed recording can stand for; real ones are below a tenth of it.
MOST_EXPANSION = 1000
_BLOCK_BYTES = 1 << 20
_MESSAGE_HEAD = struct.Struct('<HIQQ')


#: Number of the file, and the chunk's place in it.
Key = tuple[int, int]


class RawMessage(NamedTuple):
    """One message as the file holds it, and where its data lie in its span's records."""

    channel_id: int
    log_time: int  #: ns
    publish_time: int  #: ns
    start: int
    end: int


def decompress(data: memoryview, compression: str, size: int, crc: int) -> memoryview:
    """A whole chunk's records.

    Raises:
        BagError: compression unknown, the bytes are damaged, or more than LARGEST come out.
    """
    refuse_too_large(size, 'a chunk')
    if compression == '':
        records = data
    elif compression == 'zstd':
        records = unpacked_zstd(data, size, 'zstd chunk')
    elif compression == 'lz4':
        import lz4.frame

        try:
            records = memoryview(lz4.frame.LZ4FrameDecompressor().decompress(data, size))
        except (RuntimeError, MemoryError) as error:
            message = f'lz4 chunk is damaged: {error}'
            raise BagError(message) from error
    else:
        message = f"chunk compression '{compression}' is unknown (known: zstd, lz4, none)"
        raise BagError(message)
    if len(records) != size or (crc and zlib.crc32(records) != crc):
        message = 'chunk is damaged: its checksum or size does not match'
        raise BagError(message)
    return records


def refuse_too_large(size: int, what: str) -> None:
    """Refuse to take that much into memory at a time.

    Raises:
        BagError: more than LARGEST.
    """
    if size > LARGEST:
        message = f'{what} of {size} bytes is larger than {LARGEST >> 20} MiB: damaged, or a trap'
        raise BagError(message)


def unpacked_zstd(data: bytes | memoryview, most: int, what: str) -> memoryview:
    """What a zstd frame holds, of at most `most` bytes.

    Raises:
        BagError: no zstd frame, damaged, or it holds more.
    """
    import zstandard

    try:
        # The library takes the frame's word for the size before the limit that it is given.
        if zstandard.frame_content_size(data) > most:
            message = f'{what} is damaged: it unpacks to more than the {most} bytes it should'
            raise BagError(message)
        return memoryview(zstandard.ZstdDecompressor().decompress(data, max_output_size=most))
    except (zstandard.ZstdError, MemoryError) as error:
        message = f'{what} is damaged: {error}'
        raise BagError(message) from error


def unpack_file(packed: Path, unpacked: Path) -> None:
    """Unpack a file compressed by zstd.

    Raises:
        BagError: no zstd file, damaged, or more comes out than a recording can hold or the
            folder has room for.
    """
    import zstandard

    most = min(
        packed.stat().st_size * MOST_EXPANSION, shutil.disk_usage(unpacked.parent).free // 2
    )
    try:
        with packed.open('rb') as source, unpacked.open('wb') as target:
            content = zstandard.ZstdDecompressor().stream_reader(source)
            while block := content.read(_BLOCK_BYTES):
                if target.tell() + len(block) > most:
                    message = (
                        f'{packed}: more than {most >> 20} MiB come out of its '
                        f'{packed.stat().st_size} bytes: unpack it with `zstd -d`, if you trust it'
                    )
                    raise BagError(message)
                target.write(block)
    except (zstandard.ZstdError, OSError, MemoryError) as error:
        message = f'{packed}: not a zstd file, or damaged: {error}'
        raise BagError(message) from error


def salvage(data: memoryview, compression: str, size: int) -> memoryview:
    """As many of a torn chunk's records as its first bytes give; the last may be cut.

    `size` is that of the whole chunk's records.
    """
    most = min(size, LARGEST)
    if compression == 'zstd':
        import zstandard

        try:
            return memoryview(zstandard.ZstdDecompressor().stream_reader(data).read(most))
        except zstandard.ZstdError:
            return memoryview(b'')
    if compression == 'lz4':
        import lz4.frame

        try:
            return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(data, most))
        except RuntimeError:
            return memoryview(b'')
    return data[:most] if compression == '' else memoryview(b'')


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
    return RawMessage(channel_id, log_time, publish_time, start + _MESSAGE_HEAD.size, end)


class ChunkStore:
    """The unpacked chunks that messages wait in, at most LARGEST bytes of them.

    Where more are waited for, the oldest is given up, and its reader has to read it again.
    """

    def __init__(self) -> None:
        self._records: dict[Key, memoryview] = {}
        self._holds: Counter[Key] = Counter()
        self._bytes = 0

    def get(self, key: Key) -> memoryview | None:
        """A chunk's records, None where they have to be read."""
        return self._records.get(key)

    def put(self, key: Key, records: memoryview) -> None:
        """Keep a chunk's records, in place of older ones if there is no room."""
        self._records[key] = records
        self._bytes += len(records)
        while self._bytes > LARGEST and len(self._records) > 1:
            self._drop(next(iter(self._records)))

    def hold(self, key: Key) -> None:
        """One more message waits in this chunk."""
        self._holds[key] += 1

    def release(self, key: Key) -> None:
        """One message less waits in this chunk, which goes with the last."""
        self._holds[key] -= 1
        self.drop_unheld(key)

    def drop_unheld(self, key: Key) -> None:
        """Let a chunk go that nothing waits in."""
        if self._holds[key] <= 0:
            del self._holds[key]
            self._drop(key)

    def _drop(self, key: Key) -> None:
        self._bytes -= len(self._records.pop(key, b''))
