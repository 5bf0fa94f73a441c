"""Bags, calibrations and metadata that lie: bombs, impossible lengths, and damage at random."""

from __future__ import annotations

import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import zstandard
from lz4 import frame as lz4_frame
from mcap.writer import CompressionType, Writer

from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from binopos_ros.bag.index import MAGIC

STAMP = 1_700_000_000_000_000_000
#: More than is ever taken into memory at a time, of little on the disk.
MUCH = 600 << 20
NESTED = '[' * 20_000 + ']' * 20_000
LAUGHS = '\n'.join(
    ['a0: &a0 [x, x, x, x, x, x, x, x, x, x]']
    + [f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 10)}]' for k in range(1, 30)]
)


def image_bag(path: Path, compression: str = 'none', pairs: int = 4) -> Path:
    """A small bag of two cameras."""
    random = np.random.default_rng(1)
    topics = [f'/stereo/{side}/image_raw/compressed' for side in ('left', 'right')]
    with BagWriter(path, compression=compression, chunk_bytes=700) as writer:
        for topic in topics:
            writer.add_topic(topic, messages.COMPRESSED_IMAGE)
        for number in range(pairs):
            for topic in topics:
                stamp = STAMP + number * 33_000_000
                picture = messages.compressed_image(stamp, 'cam', random.bytes(200))
                writer.write(topic, stamp, picture)
    return path


def record(opcode: int, content: bytes, length: int | None = None) -> bytes:
    """One record of an MCAP file; `length` where it lies."""
    return struct.pack('<BQ', opcode, len(content) if length is None else length) + content


def chunk(packed: bytes, compression: str, size: int, crc: int = 0) -> bytes:
    """A chunk that says it unpacks to `size` bytes."""
    name = compression.encode()
    fields = struct.pack('<QQQII', STAMP, STAMP, size, crc, len(name)) + name
    return record(6, fields + struct.pack('<Q', len(packed)) + packed)


def mcap(*records: bytes) -> bytes:
    """A file without a summary."""
    header = struct.pack('<I', 4) + b'ros2' + struct.pack('<I', 0)
    return MAGIC + record(1, header) + b''.join(records) + record(15, bytes(4)) + MAGIC


def zeros(size: int) -> Iterator[bytes]:
    """Blocks of zeros."""
    block = bytes(1 << 20)
    for _ in range(size >> 20):
        yield block


def zstd(size: int, *, told: bool = True) -> bytes:
    """A frame of so many zeros, which says so or not."""
    if told:
        return zstandard.ZstdCompressor(level=1).compress(bytes(size))
    compressor = zstandard.ZstdCompressor(level=1).compressobj()
    return b''.join(map(compressor.compress, zeros(size))) + compressor.flush()


def traps(folder: Path) -> dict[str, Path]:
    """Bags that take the memory, the disk or the time of who believes them."""
    files = {
        'zstd_bomb': mcap(chunk(zstd(MUCH), 'zstd', MUCH)),
        'zstd_bomb_that_lies': mcap(chunk(zstd(MUCH), 'zstd', 1000)),
        'zstd_bomb_that_is_silent': mcap(chunk(zstd(MUCH, told=False), 'zstd', 1000)),
        'lz4_bomb': mcap(chunk(lz4_frame.compress(bytes(MUCH)), 'lz4', MUCH)),
        'lz4_bomb_that_lies': mcap(chunk(lz4_frame.compress(bytes(MUCH)), 'lz4', 1000)),
        'chunk_size_of_2_63': mcap(chunk(zstd(1 << 20), 'zstd', 1 << 63)),
        'chunk_size_of_2_40': mcap(chunk(zstd(1 << 20, told=False), 'zstd', 1 << 40)),
        'plain_chunk_size_of_2_63': mcap(chunk(b'x' * 100, '', 1 << 63)),
        'record_length_lie': mcap(record(5, bytes(22), 1 << 62)),
        'schema_length_lie': mcap(record(3, bytes(2) + struct.pack('<I', 0xFFFFFFFF))),
        'unknown_compression': mcap(chunk(b'x' * 100, 'rar', 100)),
        'summary_of_the_whole_file': summary_that_is_the_file(),
    }
    found: dict[str, Path] = {}
    for name, data in files.items():
        found[name] = folder / f'{name}.mcap'
        found[name].write_bytes(data)
    packed = zstandard.ZstdCompressor(level=1).compressobj()
    blocks = [packed.compress(MAGIC), *map(packed.compress, zeros(MUCH)), packed.flush()]
    found['file_bomb'] = folder / 'file_bomb.mcap.zstd'
    found['file_bomb'].write_bytes(b''.join(blocks))
    return found


def summary_that_is_the_file() -> bytes:
    """A footer that points to the file's beginning."""
    body = mcap(chunk(b'x' * 100, '', 100))[: -len(MAGIC)]
    return body + record(2, struct.pack('<QQI', len(MAGIC), 0, 0)) + MAGIC


def message_bomb(path: Path, stated: bool) -> Path:
    """A bag of ordinary chunks in which a message is a bomb."""
    with BagWriter(path) as writer:
        for side in ('left', 'right'):
            writer.add_topic(f'/stereo/{side}/image_raw/compressed', messages.COMPRESSED_IMAGE)
            data = zstd(MUCH, told=stated)
            writer.write(f'/stereo/{side}/image_raw/compressed', STAMP, data)
    return path


def sqlite_bag(path: Path, topics: dict[str, str], rows: list[tuple[str, int, bytes]]) -> Path:
    """A database as rosbag2 of ROS 2 Foxy wrote it: without definitions."""
    connection = sqlite3.connect(path)
    connection.executescript(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
        'serialization_format TEXT, offered_qos_profiles TEXT);'
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
        'data BLOB); CREATE INDEX timestamp_idx ON messages (timestamp ASC);'
    )
    numbers = {topic: number for number, topic in enumerate(topics, 1)}
    connection.executemany(
        "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')",
        [(numbers[topic], topic, kind) for topic, kind in topics.items()],
    )
    connection.executemany(
        'INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)',
        [(numbers[topic], stamp, data) for topic, stamp, data in rows],
    )
    connection.commit()
    connection.close()
    return path


def seeds(folder: Path) -> dict[str, bytes]:
    """Whole files to damage, by suffix and number."""
    found: dict[str, bytes] = {}
    for compression in ('none', 'zstd', 'lz4'):
        path = image_bag(folder / f'{compression}.mcap', compression)
        found[f'{compression}.mcap'] = path.read_bytes()
    loose = folder / 'loose.mcap'
    with loose.open('wb') as stream:
        writer = Writer(stream, use_chunking=False, compression=CompressionType.NONE)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        for stamp in range(5):
            writer.add_message(channel, stamp, b'\0\1\0\0\5\0\0\0four\0', stamp)
        writer.finish()
    found['loose.mcap'] = loose.read_bytes()
    with BagReader(folder / 'none.mcap') as reader:
        topics = {topic: info.type for topic, info in reader.topics.items()}
        rows = [(each.topic, each.stamp_ns, each.data) for each in reader.messages()]
    found['old.db3'] = sqlite_bag(folder / 'old.db3', topics, rows).read_bytes()
    found['packed.mcap.zstd'] = zstandard.ZstdCompressor().compress(found['none.mcap'])
    found['metadata.yaml'] = metadata_of(folder)
    return found


def metadata_of(folder: Path) -> bytes:
    return (image_bag(folder / 'bag') / 'metadata.yaml').read_bytes()


LIES = (0, 1, 0xFF, 1 << 15, (1 << 31) - 1, 1 << 31, (1 << 32) - 1, 1 << 40, 1 << 62, 1 << 63)


def damaged(random: np.random.Generator, data: bytes) -> bytes:
    """The same with bytes changed, cut, doubled or left out, and with lengths that lie."""
    bad = bytearray(data)
    for _ in range(random.integers(1, 6)):
        place = int(random.integers(0, len(bad)))
        kind = random.integers(0, 6)
        if kind == 0:
            bad[place] = int(random.integers(0, 256))
        elif kind == 1:
            del bad[place : place + int(random.integers(1, 60))]
        elif kind == 2:
            bad[place:place] = bad[place : place + int(random.integers(1, 60))]
        elif kind == 3:
            width = int(random.choice((2, 4, 8)))
            lie = int(random.choice(len(LIES)))
            bad[place : place + width] = (LIES[lie] % (1 << 8 * width)).to_bytes(width, 'little')
        elif kind == 4:
            bad[place : place + 8] = random.bytes(8)
        else:
            bad = bad[: place + 1]
        bad = bad or bytearray(b'\0')
    return bytes(bad)


def read(path: Path) -> str:
    """What comes of reading all of a bag: how many messages, or in a word why none."""
    try:
        with BagReader(path) as reader:
            count = refused = 0
            for each in reader.messages():
                count += 1
                try:
                    reader.decode(each)
                except BagError:
                    refused += 1
    except BagError as error:
        if '\n' in str(error):
            message = f'more than one line: {error}'
            raise RuntimeError(message) from error
        return 'refused'
    return 'read with loss' if reader.warnings or refused else f'read {min(count, 1)}'


def inputs(folder: Path, count: int, seed: int) -> Iterator[tuple[str, Callable[[], str]]]:
    """Damaged files one after another: a name, and what reads it."""
    random = np.random.default_rng(seed)
    whole = seeds(folder)
    names = list(whole)
    target = folder / 'damaged'
    bag = image_bag(folder / 'folder')
    for number in range(count):
        name = names[number % len(names)]
        bad = damaged(random, whole[name])
        if name == 'metadata.yaml':
            path, to_read = bag / 'metadata.yaml', bag
        else:
            path = to_read = target.with_name(f'damaged.{name.partition(".")[2]}')
        path.write_bytes(bad)
        yield f'{name} {number} {zlib.crc32(bad):08x}', lambda to_read=to_read: read(to_read)
