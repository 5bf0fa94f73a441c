"""Bags beside the libraries that also read and write them, in one run.

    python bench/bag/libraries.py [--pairs 300] [--bytes 200000]

Reads and decodes a bag of JPEG pairs, and writes it; all taking
turns. Peak memory is what reading allocates. Ours alone checks the chunks' checksums on the way.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from binopos_ros.bag import BagReader, BagWriter, messages
from binopos_ros.bag.definitions import definition_of, jazzy
from figures import Column, Figures

TOPICS = ('/stereo/left/image_raw/compressed', '/stereo/right/image_raw/compressed')
REPEATS = 7
PAIRS, SIZE = 300, 200_000
START, PERIOD = 1_700_000_000_000_000_000, 33_333_333

Message = tuple[str, int, bytes]


def pairs(count: int, size: int) -> list[Message]:
    random = np.random.default_rng(0)
    jpeg = random.bytes(size)
    found = []
    for number in range(count):
        stamp = START + number * PERIOD
        for topic in TOPICS:
            image = messages.compressed_image(stamp, 'camera', jpeg)
            found.append((topic, stamp, bytes(jazzy().serialize_cdr(image, image.__msgtype__))))
    return found


def write_ours(path: Path, given: list[Message], *, crash_safe: bool = False) -> None:
    with BagWriter(path, crash_safe=crash_safe) as writer:
        for topic in TOPICS:
            writer.add_topic(topic, messages.COMPRESSED_IMAGE)
        for topic, stamp, data in given:
            writer.write(topic, stamp, data)


def write_crash_safe(path: Path, given: list[Message]) -> None:
    write_ours(path, given, crash_safe=True)


def write_mcap(path: Path, given: list[Message]) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start('ros2')
        text = definition_of(messages.COMPRESSED_IMAGE).text.encode()
        schema = writer.register_schema(messages.COMPRESSED_IMAGE, 'ros2msg', text)
        channels = {topic: writer.register_channel(topic, 'cdr', schema) for topic in TOPICS}
        for topic, stamp, data in given:
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()


def write_rosbags(path: Path, given: list[Message]) -> None:
    with RosbagsWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {
            topic: writer.add_connection(topic, messages.COMPRESSED_IMAGE, typestore=jazzy())
            for topic in TOPICS
        }
        for topic, stamp, data in given:
            writer.write(connections[topic], stamp, data)


def read_ours(path: Path) -> int:
    with BagReader(path) as reader:
        return sum(reader.decode(record).data.size for record in reader.messages())


def read_rosbags(path: Path) -> int:
    with Reader(path) as reader:
        return sum(
            jazzy().deserialize_cdr(data, connection.msgtype).data.size
            for connection, _, data in reader.messages()
        )


def read_mcap(path: Path) -> int:
    (file,) = path.glob('*.mcap')
    with file.open('rb') as stream:
        return sum(
            jazzy().deserialize_cdr(message.data, schema.name).data.size
            for schema, _, message in make_reader(stream).iter_messages()
            if schema is not None
        )


def timed(works: dict[str, Callable[[], object]]) -> dict[str, list[float]]:
    """Times of each work, all taking turns so that a busy machine is busy for all, s."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(REPEATS):
        for name, work in works.items():
            start = time.perf_counter()
            work()
            times[name].append(time.perf_counter() - start)
    return times


def peak(work: Callable[[], object]) -> float:
    tracemalloc.start()
    work()
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most / 1e6


def anew(write: Callable[[Path, list[Message]], None], path: Path, given: list[Message]) -> None:
    write(path, given)
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--pairs', type=int, default=PAIRS)
    parser.add_argument('--bytes', type=int, default=SIZE, help='of each image')
    arguments = parser.parse_args()
    given = pairs(arguments.pairs, arguments.bytes)
    megabytes = sum(len(data) for _, _, data in given) / 1e6
    folder = Path(tempfile.mkdtemp(prefix='binopos_bench_'))
    try:
        print(f'{len(given)} images of {arguments.bytes} bytes, {megabytes:.0f} MB')
        found = Figures('bag/libraries', peers=('rosbags', 'mcap'))
        bag = folder / 'bag'
        write_ours(bag, given)
        ratio = Column('of ours, by the least', '.2f', '<')
        table = found.table(
            'reading',
            'reading and decoding',
            Column('time, s', '.3f'),
            ratio,
            Column('peak memory, MB', '.1f'),
        )
        readers = {'ours': read_ours, 'rosbags': read_rosbags, 'mcap': read_mcap}
        times = timed({name: partial(read, bag) for name, read in readers.items()})
        for name, seconds in times.items():
            memory = peak(partial(readers[name], bag))
            table.row(name, seconds, min(seconds) / min(times['ours']), memory)
        table = found.table('writing', 'writing', Column('time, s', '.3f'), ratio)
        writers = {
            'ours': write_ours,
            'ours, whole after every chunk': write_crash_safe,
            'rosbags': write_rosbags,
            'mcap': write_mcap,
        }
        written = timed(
            {name: partial(anew, write, folder / 'new', given) for name, write in writers.items()}
        )
        for name, seconds in written.items():
            least = min(seconds) / min(written['ours'])
            table.row(name, seconds, least, compared=name in readers)
        if (arguments.pairs, arguments.bytes) == (PAIRS, SIZE):
            found.keep()
    finally:
        shutil.rmtree(folder)


if __name__ == '__main__':
    main()
