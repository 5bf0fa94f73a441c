"""Whole, compressed and misplaced bags."""

from __future__ import annotations

import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType, IndexType, Writer

from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from stored import read

MakeBag = Callable[..., Path]


def write_with_mcap(path: Path, stamps: list[int], **options: object) -> None:
    """A file by the mcap library's writer."""
    with path.open('wb') as stream:
        writer = Writer(stream, **options)  # type: ignore[arg-type]
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        for number, stamp in enumerate(stamps):
            writer.add_message(channel, stamp, b'\0\1\0\0%8d' % number, stamp)
        writer.finish()


@pytest.mark.parametrize('compression', ['none', 'zstd', 'lz4'])
def test_reads_every_compression(make_bag: MakeBag, tmp_path: Path, compression: str) -> None:
    plain = read(make_bag(tmp_path / 'plain'))
    assert read(make_bag(tmp_path / 'packed', compression=compression)) == plain
    assert len(plain) == 40


def test_filters_by_topic_and_time(make_bag: MakeBag, tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'bag', chunk_bytes=5000)
    with BagReader(path) as reader:
        left = '/stereo/left/image_raw/compressed'
        everything = [record for record in reader.messages() if record.topic == left]
        middle = everything[7].stamp_ns
        assert list(reader.messages([left])) == everything
        assert list(reader.messages([left], start_ns=middle)) == everything[7:]
        assert list(reader.messages([])) == []
        assert list(reader.messages(['/unheard/of'])) == []


@pytest.mark.parametrize('stamps', [[5, 3, 4, 1, 2], [2, 2, 2, 1, 1], [1, 2, 3, 4, 5]])
@pytest.mark.parametrize('chunked', [True, False])
def test_messages_come_in_the_order_of_time_and_of_the_file(
    tmp_path: Path, stamps: list[int], chunked: bool
) -> None:
    path = tmp_path / 'unordered.mcap'
    write_with_mcap(path, stamps, chunk_size=1, use_chunking=chunked)
    expected = sorted(range(len(stamps)), key=lambda number: stamps[number])
    assert [int(data[4:]) for _, _, data in read(path)] == expected


@pytest.mark.parametrize(
    'options',
    [
        {'use_chunking': False},
        {'index_types': IndexType.NONE},
        {'index_types': IndexType.CHUNK},
        {'index_types': IndexType.MESSAGE, 'use_statistics': False},
        {'repeat_channels': False, 'repeat_schemas': False},
        {'use_summary_offsets': False, 'enable_crcs': False},
        {'compression': CompressionType.LZ4},
    ],
    ids=str,
)
def test_reads_files_of_writers_that_leave_things_out(
    tmp_path: Path, options: dict[str, object]
) -> None:
    path = tmp_path / 'sparse.mcap'
    write_with_mcap(path, list(range(100, 200)), chunk_size=200, **options)
    with BagReader(path) as reader:
        assert [record.stamp_ns for record in reader.messages()] == list(range(100, 200))
        assert reader.topics['/chatter'].count == 100
        assert (reader.start_ns, reader.end_ns) == (100, 199)
        assert reader.warnings == []


def test_a_whole_file_is_read_by_its_index_alone(make_bag: MakeBag, tmp_path: Path) -> None:
    # Opening must not touch the chunks: a recording of hours opens at once.
    path = make_bag(tmp_path / 'bag.mcap', chunk_bytes=5000)
    data = bytearray(path.read_bytes())
    data[100:2000] = bytes(1900)
    path.write_bytes(data)
    with BagReader(path) as reader:
        assert reader.message_count == 40


def test_a_file_without_a_summary_is_not_taken_into_memory(tmp_path: Path) -> None:
    path = tmp_path / 'long.mcap'
    with path.open('wb') as stream:
        writer = Writer(
            stream,
            use_chunking=False,
            index_types=IndexType.NONE,
            repeat_channels=False,
            repeat_schemas=False,
            use_statistics=False,
            use_summary_offsets=False,
        )
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        for stamp in range(60):
            writer.add_message(channel, stamp, bytes(1 << 20), stamp)
        writer.finish()
    tracemalloc.start()
    with BagReader(path) as reader:
        count = sum(1 for _ in reader.messages())
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count == 60
    assert most < 12 << 20


def test_messages_that_all_overlap_are_read_in_the_memory_of_a_chunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each chunk holds a message of the time zero, so that all of them overlap."""
    monkeypatch.setattr('binopos_ros.bag.chunks.LARGEST', 4 << 20)
    path = tmp_path / 'overlapping.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=1 << 20, compression=CompressionType.NONE)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        for stamp in range(1, 200):
            writer.add_message(channel, 0, bytes(100), 0)
            writer.add_message(channel, stamp, bytes([stamp]) * (200 << 10), stamp)
        writer.finish()
    tracemalloc.start()
    with BagReader(path) as reader:
        found = [(record.stamp_ns, record.data[:1]) for record in reader.messages()]
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found == [(0, b'\0')] * 199 + [(stamp, bytes([stamp])) for stamp in range(1, 200)]
    assert most < 10 << 20


def test_a_folder_without_metadata_orders_its_parts_itself(
    make_bag: MakeBag, tmp_path: Path
) -> None:
    path = make_bag(tmp_path / 'bag', pairs=60, split_bytes=10_000)
    whole = read(path)
    assert len(list(path.glob('*.mcap'))) > 10
    (path / 'metadata.yaml').unlink()
    assert read(path) == whole
    # Not even the names help.
    for number, part in enumerate(sorted(path.glob('*.mcap'))):
        part.rename(path / f'{(number * 7) % 31}.mcap')
    assert read(path) == whole


def test_reads_files_that_rosbag2_compressed_whole(make_bag: MakeBag, tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'bag')
    whole = read(path)
    part = path / 'bag_0.mcap'
    (path / 'bag_0.mcap.zstd').write_bytes(zstandard.compress(part.read_bytes()))
    part.unlink()
    metadata = path / 'metadata.yaml'
    metadata.write_text(metadata.read_text().replace('bag_0.mcap', 'bag_0.mcap.zstd'))
    assert read(path) == whole
    assert read(path / 'bag_0.mcap.zstd') == whole


def test_reads_messages_that_rosbag2_compressed_one_by_one(
    make_bag: MakeBag, tmp_path: Path
) -> None:
    whole = read(make_bag(tmp_path / 'whole'))
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        for topic in ('/stereo/left/image_raw/compressed', '/stereo/right/image_raw/compressed'):
            writer.add_topic(topic, messages.COMPRESSED_IMAGE)
        for stamp, topic, data in whole:
            writer.write(topic, stamp, zstandard.compress(data))
    metadata = path / 'metadata.yaml'
    metadata.write_text(
        metadata.read_text()
        .replace('compression_mode: ""', 'compression_mode: MESSAGE')
        .replace('compression_format: ""', 'compression_format: zstd')
    )
    assert read(path) == whole


@pytest.mark.parametrize(
    ('name', 'content', 'reason'),
    [
        ('missing', None, 'no such bag'),
        ('empty.mcap', b'', 'file is empty'),
        ('text.mcap', b'%YAML 1.2\nthis is no bag', 'not an MCAP file'),
        ('short.mcap', b'\x89MC', 'not an MCAP file'),
        ('broken.mcap.zstd', b'nothing compressed', 'not a zstd file'),
        ('old.db3', b'SQLite format 3\0', 'sqlite3'),
    ],
)
def test_what_is_no_bag_is_refused_in_one_line(
    tmp_path: Path, name: str, content: bytes | None, reason: str
) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(BagError, match=reason) as refusal:
        BagReader(path)
    assert str(path) in str(refusal.value)
    assert '\n' not in str(refusal.value)


def test_a_folder_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=r'holds no \.mcap file'):
        BagReader(tmp_path)
    (tmp_path / 'old.db3').write_bytes(b'')
    with pytest.raises(BagError, match='sqlite3'):
        BagReader(tmp_path)


def test_a_bag_without_messages_reads_as_such(make_bag: MakeBag, tmp_path: Path) -> None:
    with BagReader(make_bag(tmp_path / 'bag', pairs=0)) as reader:
        assert list(reader.messages()) == []
        assert len(reader.topics) == 2
        assert reader.warnings == []


def test_decoded_images_are_views_of_the_bytes(make_bag: MakeBag, tmp_path: Path) -> None:
    with BagReader(make_bag(tmp_path / 'bag', pairs=1)) as reader:
        message = reader.decode(next(reader.messages()))
    assert not message.data.flags.owndata


def test_memory_does_not_grow_with_the_bag(make_bag: MakeBag, tmp_path: Path) -> None:
    peaks = []
    for pairs in (300, 3000):
        path = make_bag(tmp_path / f'{pairs}', pairs=pairs, size=5000)
        with BagReader(path) as reader:
            next(reader.messages())
            tracemalloc.start()
            count = sum(len(record.data) > 0 for record in reader.messages())
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        assert count == 2 * pairs
        shutil.rmtree(path)
    # The larger bag's chunk list is sorted: a few bytes per MiB.
    assert peaks[1] < 1.02 * peaks[0] + 50_000
