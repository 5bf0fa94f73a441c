"""What a recording keeps of the nodes, and that it misses nothing of publishers that change."""

from __future__ import annotations

import time

import pytest
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import CameraInfo

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import stamp_of
from binopos_ros.node_options import Parameters
from binopos_ros.nodes.messages import pose_message
from binopos_ros.optics import read_camera_info

pytestmark = pytest.mark.live

POSE = '/stereo/target/pose'
SENSOR = QoSProfile(depth=50, reliability=QoSReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
COUNT = 150


def pose(number):
    return pose_message(number, 'left', (0.0, 0.0, 1.0), [[1.0, 0.0], [0.0, 1.0]])


def feed(peer, publisher, numbers):
    """Publish poses with these stamps, at 200 Hz."""
    for number in numbers:
        publisher.publish(pose(number))
        until = time.monotonic() + 0.005
        peer.wait_for(lambda until=until: time.monotonic() > until, 'its time')


def recorded(bag, topic=POSE):
    with BagReader(bag) as reader:
        if topic not in reader.topics:
            return []
        return [stamp_of(reader.decode(record)) for record in reader.messages([topic])]


def calibration(width=640):
    info = CameraInfo(width=width, height=480, distortion_model='plumb_bob')
    info.k = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [500.0, 0.0, 320.0, 0.0, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    info.d = [0.0] * 5
    return info


def test_a_suite_that_comes_later_is_recorded_from_its_first_message(start, peer, tmp_path):
    """And a publisher that comes back with less quality of service is recorded on, each once."""
    bag = tmp_path / 'bag'
    node = start('recorder', parameters={'recorder': {'bag': str(bag)}})
    # Heard before there is anybody to hear.
    peer.wait_for(lambda: peer.node.count_subscribers(POSE) == 1, 'the recorder')
    poses = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    peer.wait_for(lambda: poses.get_subscription_count() == 1, 'the connection')
    feed(peer, poses, range(COUNT))
    # A driver that is started again, with sensor data's quality of service.
    lesser = peer.node.create_publisher(PoseWithCovarianceStamped, 'target/pose', SENSOR)
    peer.wait_for(lambda: lesser.get_subscription_count() == 1, 'the lesser connection')
    feed(peer, lesser, range(COUNT, 2 * COUNT))
    # Both kinds of subscription hear this one.
    feed(peer, poses, range(2 * COUNT, 3 * COUNT))
    peer.wait_for(lambda: len(recorded(bag)) >= 3 * COUNT, 'the poses on the disk')
    assert node.end()[0] == 0
    assert recorded(bag) == list(range(3 * COUNT))


def test_a_recording_holds_the_parameters_and_the_calibration(start, peer, tmp_path):
    bag = tmp_path / 'dive'
    interface = {
        'interface.normal': [0.0, 0.0, 1.0],
        'interface.distance': 0.8,
        'interface.indices': [1.0, 1.333],
        'epipolar_gate': 7.0,
    }
    start('triangulator', 'smoother', parameters={'triangulator': interface})
    left = peer.node.create_publisher(CameraInfo, 'left/camera_info', LATCHED)
    left.publish(calibration())
    node = start('recorder', parameters={'recorder': {'bag': str(bag)}})

    def kept():
        path = bag / 'binopos.yaml'
        return set(yaml.safe_load(path.read_text())) if path.is_file() else set()

    both = {'/stereo/smoother', '/stereo/triangulator'}
    peer.wait_for(lambda: kept() == both and (bag / 'left.yaml').is_file(), 'the files')
    assert node.end()[0] == 0
    parameters = Parameters([bag / 'binopos.yaml'])
    values = parameters.of_node('triangulator')
    assert {name: values[name] for name in interface} == {
        **interface,
        'interface.normal': (0.0, 0.0, 1.0),
        'interface.indices': (1.0, 1.333),
    }
    parameters.check('triangulator')
    parameters.check('smoother')
    assert read_camera_info(bag / 'left.yaml').width == 640
