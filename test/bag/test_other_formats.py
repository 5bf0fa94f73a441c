"""Bags in sqlite3 and of ROS 1, and messages that are compressed one by one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import zstandard
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

import malice
from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from binopos_ros.optics import CameraInfo
from binopos_ros.optics.camera_info_message import read_camera_info_message

START = 1_700_000_000_000_000_000
IMAGE, INFO = '/stereo/left/image_raw', '/stereo/left/camera_info'
K = (500.0, 0.0, 31.5, 0.0, 510.0, 23.5, 0.0, 0.0, 1.0)
D = (0.1, -0.2, 0.003, 0.004, 0.05)
P = (490.0, 0.0, 31.0, -49.0, 0.0, 490.0, 23.0, 0.0, 0.0, 0.0, 1.0, 0.0)


def pixels(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def check(path: Path, count: int) -> None:
    """The bag holds so many images and a calibration, in order, as they were written."""
    with BagReader(path) as reader:
        assert reader.topics[IMAGE].count == count
        assert reader.topics[IMAGE].type == messages.IMAGE
        assert (reader.start_ns, reader.end_ns) == (START, START + count - 1)
        records = list(reader.messages([IMAGE]))
        for number, record in enumerate(records):
            message = reader.decode(record)
            assert messages.stamp_of(message) == START + number
            assert messages.serialized_stamp(record.data) == START + number
            assert message.encoding == 'bgr8'
            assert message.header.frame_id == 'cam'
            assert np.array_equal(message.data, pixels(number).ravel())
        assert len(records) == count
        assert len(list(reader.messages([IMAGE], start_ns=START + 2))) == count - 2
        (record,) = reader.messages([INFO])
        info = read_camera_info_message(reader.decode(record), 'left')
        assert (info.k, info.d, info.p, info.width) == (K, D, P, 64)


COUNT = 5
MESSAGES = {
    IMAGE: messages.IMAGE,
    INFO: messages.CAMERA_INFO,
}


def written() -> Iterator[tuple[str, int, object]]:
    info = CameraInfo('left', 64, 48, 'plumb_bob', D, K, p=P)
    yield INFO, START, messages.camera_info(START, 'cam', info)
    for number in range(COUNT):
        stamp = START + number
        yield (
            IMAGE,
            stamp,
            messages.image(stamp, 'cam', pixels(number).ravel(), (64, 48), 'bgr8', 192),
        )


@pytest.mark.parametrize('version', [8, 9])
def test_reads_sqlite_as_rosbags_writes_it(tmp_path: Path, version: int) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / 'bag'
    with Ros2Writer(path, version=version, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in MESSAGES.items()
        }
        for topic, stamp, message in written():
            data = store.serialize_cdr(message, MESSAGES[topic])
            writer.write(connections[topic], stamp, data)
    check(path, COUNT)
    check(next(path.glob('*.db3')), COUNT)
    (path / 'metadata.yaml').unlink()
    check(path, COUNT)


def test_reads_sqlite_without_definitions_in_parts_and_packed(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    rows = [
        (topic, stamp, bytes(store.serialize_cdr(message, MESSAGES[topic])))
        for topic, stamp, message in written()
    ]
    bag = tmp_path / 'bag'
    bag.mkdir()
    for number, part in enumerate((rows[:3], rows[3:])):
        path = malice.sqlite_bag(bag / f'bag_{number}.db3', MESSAGES, part)
        packed = path.with_suffix('.db3.zstd')
        packed.write_bytes(zstandard.ZstdCompressor().compress(path.read_bytes()))
        path.unlink()
    check(bag, COUNT)


@pytest.mark.parametrize('compression', ['LZ4', 'BZ2'])
def test_reads_a_bag_of_ros_1(tmp_path: Path, compression: str) -> None:
    """With what ROS 1 had otherwise: a header's seq, and D, K, R, P in capitals."""
    store = get_typestore(Stores.ROS1_NOETIC)
    path = tmp_path / 'run.bag'
    types = store.types
    writer = Ros1Writer(path)
    writer.set_compression(getattr(Ros1Writer.CompressionFormat, compression))
    with writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in MESSAGES.items()
        }
        for topic, stamp, message in written():
            time = types['builtin_interfaces/msg/Time'](*divmod(stamp, 10**9))
            header = types['std_msgs/msg/Header'](seq=7, stamp=time, frame_id='cam')
            if topic == IMAGE:
                fields = ('height', 'width', 'encoding', 'is_bigendian', 'step', 'data')
                given = {name: getattr(message, name) for name in fields}
            else:
                roi = types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
                given = {name.upper(): getattr(message, name) for name in 'dkrp'}
                for name in ('height', 'width', 'distortion_model', 'binning_x', 'binning_y'):
                    given[name] = getattr(message, name)
                given['roi'] = roi
            own = types[MESSAGES[topic]](header=header, **given)
            writer.write(connections[topic], stamp, store.serialize_ros1(own, MESSAGES[topic]))
    check(path, COUNT)


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('a.bag', b''),
        ('b.bag', b'#ROSBAG V2.0\nnothing'),
        ('c.bag', b'#ROSBAG V1.2\n'),
        ('d.db3', b'SQLite format 3\0' + bytes(200)),
        ('e.db3', b'no database'),
    ],
)
def test_what_is_none_of_them_is_one_line(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(BagError, match=name) as refusal:
        BagReader(tmp_path / name)
    assert '\n' not in str(refusal.value)


def test_messages_compressed_one_by_one_need_no_metadata(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    bag = tmp_path / 'bag'
    with BagWriter(bag) as writer:
        for topic, kind in MESSAGES.items():
            writer.add_topic(topic, kind)
        for topic, stamp, message in written():
            data = bytes(store.serialize_cdr(message, MESSAGES[topic]))
            writer.write(topic, stamp, zstandard.ZstdCompressor().compress(data))
    check(bag, COUNT)
    (bag / 'metadata.yaml').unlink()
    check(bag, COUNT)
    assert caplog.records == []


def test_files_that_the_metadata_do_not_list_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bag = malice.image_bag(tmp_path / 'bag')
    data = (bag / 'bag_0.mcap').read_bytes()
    for number in range(1, 12):
        (bag / f'bag_{number}.mcap').write_bytes(data)
    with BagReader(bag) as reader:
        assert reader.message_count == 8
    assert 'metadata.yaml lists 1 of 12 files; the other 11 are left out' in caplog.text
