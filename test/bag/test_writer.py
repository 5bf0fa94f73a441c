"""Bags as others read them: the mcap library, rosbags, and the rules of rosbag2."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.typesys import Stores, get_typestore

from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from binopos_ros.bag.definitions import Definition
from binopos_ros.bag.qos import Qos
from binopos_ros.bag.results import pose_with_covariance, vector3
from stored import read

MakeBag = Callable[..., Path]
STRING = 'std_msgs/msg/String'
COMPRESSIONS = ['none', 'zstd', 'lz4']


def read_with_mcap(path: Path, *, seeking: bool) -> list[tuple[int, str, bytes]]:
    with path.open('rb') as stream:
        reader = (
            make_reader(stream, validate_crcs=True)
            if seeking
            else NonSeekingReader(stream, validate_crcs=True)
        )
        return [
            (message.log_time, channel.topic, message.data)
            for _, channel, message in reader.iter_messages()
        ]


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_the_mcap_library_reads_what_we_write(
    make_bag: MakeBag, tmp_path: Path, compression: str
) -> None:
    path = make_bag(tmp_path / 'bag.mcap', compression=compression, chunk_bytes=9000)
    assert len(read(path)) == 40
    assert read_with_mcap(path, seeking=True) == read(path)
    assert read_with_mcap(path, seeking=False) == read(path)


def test_the_file_says_what_rosbag2_expects_of_it(make_bag: MakeBag, tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'bag.mcap')
    with path.open('rb') as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 40
    for channel in summary.channels.values():
        assert channel.message_encoding == 'cdr'
        assert set(channel.metadata) == {'offered_qos_profiles', 'topic_type_hash'}
        schema = summary.schemas[channel.schema_id]
        assert (schema.name, schema.encoding) == ('sensor_msgs/msg/CompressedImage', 'ros2msg')
        assert b'MSG: std_msgs/Header' in schema.data


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_rosbags_reads_a_split_bag_and_its_messages(tmp_path: Path, compression: str) -> None:
    path = tmp_path / 'bag'
    offered = Qos('best_effort', 'volatile', depth=5)
    with BagWriter(path, split_bytes=3000, chunk_bytes=500, compression=compression) as writer:
        writer.add_topic('/a', messages.POSE_WITH_COVARIANCE, qos=(offered,))
        writer.add_topic('/b', messages.VECTOR3)
        for number in range(100):
            stamp = 10**18 + number
            place = (number, 0, 0)
            writer.write('/a', stamp, pose_with_covariance(stamp, 'rig', place, np.eye(3)))
            writer.write('/b', stamp, vector3(stamp, 'rig', (0, number, 0)))
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsReader(path) as reader:
        assert reader.message_count == 200
        assert (reader.start_time, reader.end_time) == (10**18, 10**18 + 100)
        assert {topic: info.msgcount for topic, info in reader.topics.items()} == {
            '/a': 100,
            '/b': 100,
        }
        (profile,) = next(
            c for c in reader.connections if c.topic == '/a'
        ).ext.offered_qos_profiles
        assert (profile.reliability.name, profile.depth) == ('BEST_EFFORT', 5)
        found = [
            store.deserialize_cdr(data, connection.msgtype)
            for connection, _, data in reader.messages()
        ]
    assert sorted(
        message.pose.pose.position.x for message in found if hasattr(message, 'pose')
    ) == list(range(100))
    assert len(list(path.glob('*.mcap'))) > 3


def test_metadata_has_every_field_that_rosbag2_of_jazzy_asks_for(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    with BagWriter(path, split_ns=10) as writer:
        writer.add_topic('/a', STRING, qos=(Qos(), Qos('best_effort')))
        for stamp in (100, 105, 110, 119, 120):
            writer.write('/a', stamp, b'\0\1\0\0\1\0\0\0\0')
    content = yaml.safe_load((path / 'metadata.yaml').read_text())
    information = content['rosbag2_bagfile_information']
    # rosbag2_storage/yaml.hpp reads each of these without a default from version 9 on.
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['duration'] == {'nanoseconds': 20}
    assert information['starting_time'] == {'nanoseconds_since_epoch': 100}
    assert information['message_count'] == 5
    assert information['compression_format'] == information['compression_mode'] == ''
    assert information['relative_file_paths'] == ['bag_0.mcap', 'bag_1.mcap', 'bag_2.mcap']
    assert information['custom_data'] is None
    assert information['ros_distro'] == 'jazzy'
    assert [
        (
            file['path'],
            file['starting_time']['nanoseconds_since_epoch'],
            file['duration']['nanoseconds'],
            file['message_count'],
        )
        for file in information['files']
    ] == [('bag_0.mcap', 100, 5, 2), ('bag_1.mcap', 110, 9, 2), ('bag_2.mcap', 120, 0, 1)]
    (topic,) = information['topics_with_message_count']
    assert topic['message_count'] == 5
    described = topic['topic_metadata']
    assert described['name'] == '/a'
    assert described['type'] == STRING
    assert described['serialization_format'] == 'cdr'
    assert described['type_description_hash'].startswith('RIHS01_')
    assert [offer['reliability'] for offer in described['offered_qos_profiles']] == [
        'reliable',
        'best_effort',
    ]


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    given_messages=st.lists(
        st.tuples(
            st.integers(0, 2**63 - 1), st.sampled_from(['/a', '/b', '/c']), st.binary(max_size=99)
        ),
        max_size=60,
    ),
    compression=st.sampled_from(COMPRESSIONS),
    chunk_bytes=st.integers(1, 2000),
    split_bytes=st.sampled_from([0, 100, 900]),
    crash_safe=st.booleans(),
)
def test_what_goes_in_comes_out_in_the_order_of_time(
    tmp_path: Path,
    given_messages: list[tuple[int, str, bytes]],
    compression: str,
    chunk_bytes: int,
    split_bytes: int,
    crash_safe: bool,
) -> None:
    path = tmp_path / f'bag{len(list(tmp_path.iterdir()))}'
    with BagWriter(
        path,
        compression=compression,
        chunk_bytes=chunk_bytes,
        split_bytes=split_bytes,
        crash_safe=crash_safe,
    ) as writer:
        for topic in ('/a', '/b', '/c'):
            writer.add_topic(topic, STRING)
        for stamp, topic, data in given_messages:
            writer.write(topic, stamp, data)
    assert read(path) == sorted(given_messages, key=lambda message: message[0])
    with BagReader(path) as reader:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            name: sum(topic == name for _, topic, _ in given_messages)
            for name in ('/a', '/b', '/c')
        }


@pytest.mark.parametrize('crash_safe', [True, False])
def test_the_same_messages_give_the_same_bytes(
    make_bag: MakeBag, tmp_path: Path, crash_safe: bool
) -> None:
    one = make_bag(tmp_path / 'one.mcap', crash_safe=crash_safe)
    two = make_bag(tmp_path / 'two.mcap', crash_safe=crash_safe)
    assert one.read_bytes() == two.read_bytes()


def test_a_crash_safe_bag_ends_like_any_other(make_bag: MakeBag, tmp_path: Path) -> None:
    safe = make_bag(tmp_path / 'safe.mcap', crash_safe=True, chunk_bytes=5000)
    plain = make_bag(tmp_path / 'plain.mcap', chunk_bytes=5000)
    assert safe.read_bytes() == plain.read_bytes()


def test_a_crash_safe_bag_is_whole_after_every_flush(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    writer = BagWriter(path, crash_safe=True)
    file = path / 'bag_0.mcap'
    assert read_with_mcap(file, seeking=True) == []
    writer.add_topic('/a', STRING)
    for number in range(1, 30):
        writer.write('/a', number, bytes([number]))
        if number == 7:
            writer.add_topic('/late', messages.POSE_WITH_COVARIANCE)
        writer.flush()
        expected = [(stamp, '/a', bytes([stamp])) for stamp in range(1, number + 1)]
        assert read_with_mcap(file, seeking=True) == expected
        assert read_with_mcap(file, seeking=False) == expected
        with BagReader(path) as reader:
            assert reader.message_count == number
            assert reader.warnings == []
        with RosbagsReader(path) as reader:
            assert reader.message_count == number
    writer.close()


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    flushes=st.integers(1, 6),
    size=st.integers(1, 300),
    compression=st.sampled_from(COMPRESSIONS),
    cut=st.floats(0.0, 1.0),
)
def test_a_writer_killed_in_the_middle_of_a_flush_costs_only_that_flush(
    tmp_path: Path, flushes: int, size: int, compression: str, cut: float
) -> None:
    path = tmp_path / f'bag{len(list(tmp_path.iterdir()))}.mcap'
    writer = BagWriter(path, crash_safe=True, compression=compression)
    writer.add_topic('/a', STRING)
    expected = []
    for number in range(5 * flushes):
        expected.append((number, '/a', np.random.default_rng(number).bytes(size)))
        writer.write('/a', number, expected[-1][2])
        if number % 5 == 4 and number != 5 * flushes - 1:
            writer.flush()
    before = path.read_bytes()
    writer.flush()
    after = path.read_bytes()
    writer.close()
    # What a write that is broken off leaves: its beginning, then the bytes of before.
    reached = int(cut * len(after))
    path.write_bytes(after[:reached] + before[reached:])
    found = read(path)
    assert found == expected[: len(found)]
    assert len(found) >= 5 * (flushes - 1)


def test_types_of_the_user_are_written_with_their_definition(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    definition = Definition('ros2msg', 'float64 depth\nstd_msgs/String name\n' + '=' * 80 +
                            '\nMSG: std_msgs/String\nstring data', '')  # fmt: skip
    data = b'\0\1\0\0' + np.float64(2.5).tobytes() + b'\2\0\0\0a\0'
    with BagWriter(path) as writer:
        writer.add_topic('/depth', 'my_msgs/msg/Depth', definition=definition)
        writer.write('/depth', 1, data)
    with BagReader(path) as reader:
        message = reader.decode(next(reader.messages()))
    assert (message.depth, message.name.data) == (2.5, 'a')


@pytest.mark.parametrize(
    ('act', 'reason'),
    [
        (lambda w: w.add_topic('/a', 'no_msgs/msg/Such'), "'no_msgs/msg/Such' is unknown"),
        (lambda w: w.add_topic('/taken', STRING), 'declared twice'),
        (lambda w: w.write('/b', 1, b''), 'not declared'),
    ],
)
def test_misuse_is_refused_in_one_line(
    tmp_path: Path, act: Callable[[BagWriter], None], reason: str
) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_topic('/taken', STRING)
        with pytest.raises(BagError, match=reason):
            act(writer)


@pytest.mark.parametrize('name', ['bag', 'bag.mcap'])
def test_never_writes_over_what_is_there(make_bag: MakeBag, tmp_path: Path, name: str) -> None:
    path = make_bag(tmp_path / name)
    before = read(path)
    with pytest.raises(BagError, match='exists already'):
        BagWriter(path)
    assert read(path) == before


def test_what_cannot_be_made_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / 'file').write_bytes(b'')
    with pytest.raises(BagError, match='cannot be created'):
        BagWriter(tmp_path / 'file' / 'bag')
    with pytest.raises(BagError, match='cannot be split'):
        BagWriter(tmp_path / 'bag.mcap', split_bytes=1)
    with pytest.raises(BagError, match="compression 'rar' is unknown"):
        BagWriter(tmp_path / 'other', compression='rar')


@pytest.mark.parametrize('crash_safe', [True, False])
def test_a_full_disk_costs_only_what_did_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, crash_safe: bool
) -> None:
    room = 20_000
    write = os.pwritev

    def limited(descriptor: int, parts: list[memoryview], offset: int) -> int:
        if offset >= room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, [b''.join(parts)[: room - offset]], offset)

    monkeypatch.setattr(os, 'pwritev', limited)
    path = tmp_path / 'bag'
    writer = BagWriter(path, chunk_bytes=2000, crash_safe=crash_safe)
    writer.add_topic('/a', STRING)

    def write_until_refused() -> None:
        for number in range(1000):
            writer.write('/a', number, bytes(500))

    with pytest.raises(BagError, match='no space left') as refusal:
        write_until_refused()
    assert '\n' not in str(refusal.value)
    writer.close()
    found = [stamp for stamp, _, _ in read(path)]
    assert found == list(range(len(found)))
    # Of the room only the chunk that did not fit and the index are not messages.
    assert len(found) * 531 > room - 6000
    assert f'{len(found)} messages so far stay readable' in str(refusal.value)
    assert len(read_with_mcap(path / 'bag_0.mcap', seeking=True)) == len(found)
    with BagReader(path) as reader:
        assert reader.warnings == []


WRITE_UNTIL_REFUSED = """
import sys
from binopos_ros.bag import BagError, BagReader, BagWriter
writer = BagWriter(sys.argv[1], chunk_bytes=100_000, crash_safe=True)
writer.add_topic('/a', 'std_msgs/msg/String')
try:
    for number in range(1000):
        writer.write('/a', number, bytes(10_000))
except BagError as error:
    print(error)
    writer.close()
with BagReader(sys.argv[1]) as reader:
    print(reader.message_count, sum(1 for _ in reader.messages()), len(reader.warnings))
"""


@pytest.mark.parametrize(
    'wrapper',
    [
        ['prlimit', '--fsize=2000000'],
        [
            *('unshare', '--mount', '--propagation', 'private', 'sh', '-c'),
            'mount -t tmpfs -o size=2m none "$1" && shift && exec "$@"',
            'sh',
        ],
    ],
    ids=['file size limit', 'full file system'],
)
def test_a_bag_on_a_real_full_disk_stays_readable(
    tmp_path: Path, project: Path, wrapper: list[str]
) -> None:
    disk = tmp_path / 'disk'
    disk.mkdir()
    mounting = [str(disk)] if wrapper[0] == 'unshare' else []
    try:
        subprocess.run([*wrapper, *mounting, 'true'], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        pytest.skip(f'{wrapper[0]} is not permitted here: {error}')
    command = [sys.executable, '-c', WRITE_UNTIL_REFUSED, str(disk / 'bag')]
    result = subprocess.run(
        [*wrapper, *mounting, *command], capture_output=True, text=True, cwd=project, check=True
    )
    refusal, counts = result.stdout.splitlines()
    assert 'no space left' in refusal
    counted, read_back, warnings = map(int, counts.split())
    assert counted == read_back
    assert 150 < counted < 210
    assert warnings == 0
    assert result.stderr == ''
