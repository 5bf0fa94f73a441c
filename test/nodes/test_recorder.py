"""The recorder: what it records, and that the bag survives whatever ends it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from mcap.reader import make_reader
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage
from std_srvs.srv import Trigger

from binopos_ros.bag import BagReader

pytestmark = pytest.mark.live

LEFT = '/stereo/left/image_raw/compressed'
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
SENSOR = QoSProfile(depth=5, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def image(number, size=3000):
    message = CompressedImage(format='jpeg', data=number.to_bytes(2, 'little') * (size // 2))
    message.header.stamp.sec = number
    return message


def feed(peer, publisher, count, size=3000):
    """Publish images at 50 Hz."""
    for number in range(count):
        publisher.publish(image(number, size))
        until = time.monotonic() + 0.02
        peer.wait_for(lambda until=until: time.monotonic() > until, 'its time')


def read(path):
    with BagReader(path) as reader:
        assert reader.warnings == []
        return list(reader.messages()), reader.topics


def test_records_the_suites_topics_as_they_were_offered(start, peer, tmp_path):
    images = peer.node.create_publisher(CompressedImage, LEFT, SENSOR)
    calibration = peer.node.create_publisher(CameraInfo, 'left/camera_info', LATCHED)
    stranger = peer.publisher(PoseStamped, '/stranger')
    # Published before anybody records: only a latched topic brings it.
    calibration.publish(CameraInfo(width=640))
    node = start('recorder', parameters={'recorder': {'bag': str(tmp_path / 'bag')}})
    peer.connect(images, calibration)
    feed(peer, images, 30)
    # It appears while the recorder runs.
    poses = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    peer.connect(poses)
    poses.publish(PoseWithCovarianceStamped())
    assert stranger.get_subscription_count() == 0
    peer.wait_for(lambda: file_holds(tmp_path / 'bag', 'target/pose'), 'the pose on the disk')
    assert node.end()[0] == 0
    _, topics = read(tmp_path / 'bag')
    assert numbers_of(tmp_path / 'bag') == list(range(30))
    assert topics['/stereo/left/camera_info'].count == 1
    assert topics['/stereo/target/pose'].count == 1
    assert topics['/diagnostics'].count > 0
    assert '/stranger' not in topics
    (offer,) = topics[LEFT].qos
    assert (offer.reliability, offer.durability) == ('best_effort', 'volatile')
    (offer,) = topics['/stereo/left/camera_info'].qos
    assert (offer.reliability, offer.durability) == ('reliable', 'transient_local')


def test_what_is_latched_while_the_recorder_looks_about_is_recorded_once(start, peer, tmp_path):
    """A plain subscription hears it, and a latched one that is made for it hears it again."""
    node = start('recorder', parameters={'recorder': {'bag': str(tmp_path / 'bag')}})
    calibration = peer.node.create_publisher(CameraInfo, 'left/camera_info', LATCHED)
    peer.wait_for(lambda: calibration.get_subscription_count() > 0, 'the recorder')
    calibration.publish(CameraInfo(width=640))
    peer.wait_for(lambda: calibration.get_subscription_count() == 2, 'both subscriptions')
    calibration.publish(CameraInfo(width=641))

    def widths():
        with BagReader(tmp_path / 'bag') as reader:
            infos = map(reader.decode, reader.messages(['/stereo/left/camera_info']))
            return [each.width for each in infos]

    peer.wait_for(lambda: file_holds(tmp_path / 'bag', 'left/camera_info'), 'the disk')
    peer.wait_for(lambda: 641 in widths(), 'the second on the disk')
    assert node.end()[0] == 0
    assert widths() == [640, 641]


def numbers_of(path):
    """The images' numbers, by their stamps and by their content."""
    with BagReader(path) as reader:
        images = [reader.decode(record) for record in reader.messages([LEFT])]
    for each in images:
        assert each.data.tobytes() == each.header.stamp.sec.to_bytes(2, 'little') * 1500
    return [each.header.stamp.sec for each in images]


def file_holds(path, topic):
    with BagReader(path) as reader:
        return any(name.endswith(topic) and info.count for name, info in reader.topics.items())


def test_a_killed_recorder_leaves_a_whole_bag(start, peer, tmp_path):
    images = peer.publisher(CompressedImage, LEFT)
    node = start('recorder', parameters={'recorder': {'bag': str(tmp_path / 'bag')}})
    peer.connect(images)
    feed(peer, images, 75)
    node.process.send_signal(signal.SIGKILL)
    killed = time.time_ns()
    node.wait()
    records, _ = read(tmp_path / 'bag')
    taken = numbers_of(tmp_path / 'bag')
    assert taken == list(range(len(taken)))
    assert killed - records[-1].stamp_ns < 10**9
    assert len(taken) > 25
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        assert sum(1 for _ in make_reader(stream).iter_messages()) == len(records)


@pytest.mark.parametrize(
    ('parameters', 'recorded'),
    [
        ({'topics': ['/stranger']}, {'/stranger'}),
        ({'all': True}, {'/stranger', LEFT, '/diagnostics'}),
    ],
)
def test_other_topics_are_recorded_on_demand(start, peer, tmp_path, parameters, recorded):
    stranger = peer.publisher(PoseStamped, '/stranger')
    images = peer.publisher(CompressedImage, LEFT)
    bag = tmp_path / 'bag.mcap'
    node = start('recorder', parameters={'recorder': {'bag': str(bag), **parameters}})
    peer.connect(stranger, *([images] if parameters.get('all') else []))
    stranger.publish(PoseStamped())
    images.publish(image(1))
    peer.wait_for(lambda: file_holds(bag, '/stranger'), 'the message on the disk')
    assert node.end()[0] == 0
    _, topics = read(bag)
    # With everything recorded, ROS's own topics are there as well.
    assert recorded <= set(topics)
    assert parameters.get('all') or recorded == set(topics)


def record_verb(project, *words):
    return subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'record', *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=project,
        env={**os.environ, 'PYTHONPATH': str(project)},
    )


def test_the_verb_records_until_interrupted_and_says_what(ros_domain, peer, tmp_path, project):
    images = peer.publisher(CompressedImage, LEFT)
    process = record_verb(project, '-o', str(tmp_path / 'bag'), '--compression', 'zstd')
    peer.connect(images)
    feed(peer, images, 10)
    peer.wait_for(lambda: file_holds(tmp_path / 'bag', LEFT), 'the images on the disk')
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=10)
    assert process.returncode == 0
    assert 'Traceback' not in errors
    records, topics = read(tmp_path / 'bag')
    assert f'{len(records)} messages of {len(topics)} topics recorded, 0 lost' in output


def called(peer, name):
    client = peer.node.create_client(Trigger, f'recorder/{name}')
    peer.wait_for(client.service_is_ready, f'the service {name}')
    answer = client.call_async(Trigger.Request())
    peer.wait_for(answer.done, f'the answer of {name}')
    return answer.result().success, answer.result().message


def test_recording_is_paused_and_split_by_service(start, peer, tmp_path):
    images = peer.publisher(CompressedImage, LEFT)
    bag = tmp_path / 'bag'
    node = start('recorder', parameters={'recorder': {'bag': str(bag), 'start_paused': True}})
    peer.connect(images)
    assert called(peer, 'is_paused') == (True, 'paused')
    feed(peer, images, 3)
    assert called(peer, 'resume') == (True, 'recording')
    for number in (10, 11):
        images.publish(image(number))
    peer.wait_for(lambda: file_holds(bag, LEFT), 'the images on the disk')
    assert called(peer, 'split_bagfile') == (True, 'a new file begins')
    assert called(peer, 'toggle_paused') == (True, 'paused')
    images.publish(image(12))
    assert called(peer, 'snapshot')[0] is False
    assert called(peer, 'toggle_paused') == (True, 'recording')
    images.publish(image(13))
    peer.wait_for(lambda: len(numbers_of(bag)) == 3, 'the last image on the disk')
    assert node.end()[0] == 0
    assert numbers_of(bag) == [10, 11, 13]
    assert len(list(bag.glob('*.mcap'))) == 2


def test_the_verb_keeps_the_last_seconds_for_a_snapshot(ros_domain, peer, tmp_path, project):
    images = peer.publisher(CompressedImage, LEFT)
    others = peer.publisher(CompressedImage, '/stereo/right/image_raw/compressed')
    process = record_verb(
        project,
        *('-o', str(tmp_path / 'bag'), '--snapshot', '60'),
        *('--regex', 'image_raw/compressed', '--exclude-regex', '/right/'),
    )
    peer.connect(images)
    feed(peer, images, 5)
    others.publish(image(7))
    assert not file_holds(tmp_path / 'bag', LEFT)
    assert called(peer, 'snapshot') == (True, f'5 messages go to {tmp_path / "bag"}')
    peer.wait_for(lambda: file_holds(tmp_path / 'bag', LEFT), 'the images on the disk')
    images.publish(image(8))
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=10)
    assert process.returncode == 0
    assert numbers_of(tmp_path / 'bag') == list(range(5))
    _, topics = read(tmp_path / 'bag')
    assert set(topics) == {LEFT}


def test_the_verb_does_not_write_over_a_bag(ros_domain, tmp_path, project):
    (tmp_path / 'bag').mkdir()
    process = record_verb(project, '-o', str(tmp_path / 'bag'))
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 2
    assert 'exists already: choose another name, or remove it' in errors
    assert errors.count('\n') == 1


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MB."""
    disk = tmp_path / 'disk'
    disk.mkdir()
    mount = ['mount', '-t', 'tmpfs', '-o', 'size=1m', 'none', str(disk)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip('mounting a small file system is not permitted here')
    yield disk
    subprocess.run(['umount', str(disk)], check=True)


def test_a_full_disk_ends_the_verb_with_one_line(ros_domain, peer, small_disk, project):
    images = peer.publisher(CompressedImage, LEFT)
    process = record_verb(project, '-o', str(small_disk / 'bag'), '--min-free-space', '0')
    peer.connect(images)
    feed(peer, images, 15, size=30_000)
    # Not all of it may go to the disk at once, however late a busy machine comes to that.
    peer.wait_for(lambda: file_holds(small_disk / 'bag', LEFT), 'the first images on the disk')
    feed(peer, images, 60, size=30_000)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1, errors
    lines = [line for line in errors.splitlines() if '[INFO]' not in line]
    assert len(lines) == 1, lines
    (line,) = lines
    assert 'no space left' in line
    assert 'stay readable' in line
    records, _ = read(small_disk / 'bag')
    assert sum(len(record.data) for record in records) > 300_000
