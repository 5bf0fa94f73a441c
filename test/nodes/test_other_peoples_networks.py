"""What robots have beside one suite: latched drivers, overrides, tools, other rigs, bad files."""

from __future__ import annotations

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage

from binopos_ros.nodes.messages import pose_message

pytestmark = pytest.mark.live

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
SENSOR = QoSProfile(depth=50, reliability=QoSReliabilityPolicy.BEST_EFFORT)
IN_WATER = {
    'interface.normal': [0.0, 0.0, 1.0],
    'interface.distance': 0.8,
    # A whole number among them, as people write it.
    'interface.indices': [1, 1.333],
}
BASELINE = 0.23


def calibration(side, **changes):
    info = CameraInfo(width=640, height=480, distortion_model='plumb_bob')
    info.k = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    offset = -500.0 * BASELINE if side == 'right' else 0.0
    info.p = [500.0, 0.0, 320.0, offset, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    info.d = [0.0] * 5
    for name, value in changes.items():
        setattr(info, name, value)
    return info


def centroid(stamp, u):
    return pose_message(stamp, 'left_camera', (u, 240.0, 20.0), 0.01 * np.eye(2))


class Triangulated:
    """A triangulator that is fed with centroids of a target on the axis of the left camera."""

    def __init__(self, peer, start, parameters=IN_WATER):
        self.peer = peer
        self.start = lambda: start('triangulator', parameters={'triangulator': parameters})
        pose = PoseWithCovarianceStamped
        self.centroids = {side: peer.publisher(pose, f'{side}/centroid') for side in SIDES}
        self.diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
        self.positions = peer.listen(pose, 'target/position')
        self.node = self.start()
        self.stamp = 0

    def connect(self):
        self.peer.connect(*self.centroids.values(), inputs=('target/position',))

    def feed(self, until, what):
        """Publish pairs until something holds."""

        def fed():
            self.stamp += 33_000_000
            self.centroids['left'].publish(centroid(self.stamp, 320.0))
            self.centroids['right'].publish(centroid(self.stamp, 220.0))
            pause = time.monotonic() + 0.03
            while time.monotonic() < pause:
                self.peer.executor.spin_once(timeout_sec=0.01)
            return until()

        self.peer.wait_for(fed, what)

    def status(self):
        """The newest level and message, and the values, of the triangulator's diagnostics."""
        found = [
            each
            for array in self.diagnostics
            for each in array.status
            if each.name == 'stereo/triangulator: stage'
        ]
        if not found:
            return DiagnosticStatus.OK, '', {}
        values = {item.key: item.value for item in found[-1].values}
        return found[-1].level, found[-1].message, values

    def change(self, **values):
        """Set parameters by the service, one after the other, as `ros2 param set` does."""
        client = self.peer.node.create_client(SetParameters, 'triangulator/set_parameters')
        self.peer.wait_for(client.service_is_ready, 'the service')
        answers = []
        for name, value in values.items():
            parameter = Parameter(name.replace('__', '.'), value=value).to_parameter_msg()
            answer = client.call_async(SetParameters.Request(parameters=[parameter]))
            self.peer.wait_for(answer.done, 'the answer')
            answers.append(answer.result().results[0])
        return answers


SIDES = ('left', 'right')


def test_a_latched_calibration_is_heard_whenever_the_triangulator_comes(start, peer):
    latched = {
        side: peer.node.create_publisher(CameraInfo, f'{side}/camera_info', LATCHED)
        for side in SIDES
    }
    for side, publisher in latched.items():
        publisher.publish(calibration(side))
    rig = Triangulated(peer, start)
    rig.connect()
    rig.feed(lambda: len(rig.positions) >= 3, 'positions')
    # Started again, it gets it again; and takes what a plain publisher says later.
    rig.node.end()
    rig.positions.clear()
    rig.node = rig.start()
    rig.connect()
    rig.feed(lambda: len(rig.positions) >= 3, 'positions of the second')
    depth = rig.positions[-1].pose.pose.position.z
    plain = peer.publisher(CameraInfo, 'right/camera_info')
    peer.connect(plain)
    longer = calibration('right')
    longer.p[3] *= 2.0
    plain.publish(longer)
    rig.feed(lambda: rig.positions[-1].pose.pose.position.z > 1.5 * depth, 'the new baseline')


def test_a_triangulator_survives_bad_files_and_bad_calibrations(start, peer, tmp_path):
    """Bad changes are refused whole, each side's fault stands until that side is well."""
    rig = Triangulated(peer, start)
    infos = {side: peer.publisher(CameraInfo, f'{side}/camera_info') for side in SIDES}
    peer.connect(*infos.values())
    rig.connect()
    other = tmp_path / 'other.yaml'
    other.write_text('camera_name: left\n')
    nested = tmp_path / 'nested.yaml'
    nested.write_text('[' * 20_000)
    for path in (other, nested, tmp_path, tmp_path / 'absent', '/dev/zero'):
        (answer,) = rig.change(calibration_covariance=str(path))
        assert not answer.successful, path
        assert str(path) in answer.reason
    # The layers of an interface cannot be told one by one and fit at each step: the last one
    # before them holds until they fit.
    for answer in rig.change(
        interface__indices=[1.0, 1.46, 1.333], interface__thicknesses=[0.006]
    ):
        assert answer.successful, answer.reason
    infos['left'].publish(calibration('left', d=[1e300] * 5))
    peer.wait_for(lambda: rig.status()[0] == DiagnosticStatus.ERROR, 'the error')
    infos['right'].publish(calibration('right'))
    peer.wait_for(lambda: len(rig.diagnostics) > 3, 'more diagnostics')
    assert 'left/camera_info' in rig.status()[1]
    infos['left'].publish(calibration('left'))
    rig.feed(lambda: len(rig.positions) >= 3, 'positions')
    tiny = calibration('right')
    tiny.p[3] = -500.0 * 1e-12
    for _ in range(30):
        infos['right'].publish(tiny)
    peer.wait_for(lambda: 'right/camera_info' in rig.status()[1], 'the error of the right')
    status, errors = rig.node.end()
    assert status == 0
    assert 'Traceback' not in errors
    assert errors.count('right/camera_info cannot be used') == 1


def test_parameters_can_be_dumped_and_a_second_publisher_is_told(start, peer):
    rig = Triangulated(peer, start)
    list_them = peer.node.create_client(ListParameters, 'triangulator/list_parameters')
    get_them = peer.node.create_client(GetParameters, 'triangulator/get_parameters')
    peer.wait_for(lambda: list_them.service_is_ready() and get_them.service_is_ready(), 'services')
    answer = list_them.call_async(ListParameters.Request())
    peer.wait_for(answer.done, 'the names')
    names = list(answer.result().result.names)
    answer = get_them.call_async(GetParameters.Request(names=names))
    peer.wait_for(answer.done, 'the values')
    values = dict(zip(names, map(parameter_value_to_python, answer.result().values), strict=True))
    assert list(values['interface.indices']) == [1.0, 1.333]
    assert list(values['interface.thicknesses']) == []
    assert None not in values.values()
    # What ROS's tools load again: an empty list, of which they do not know what it is empty of.
    (answer,) = rig.change(interface__thicknesses=[])
    assert answer.successful, answer.reason
    rig.connect()
    intruder = peer.node.context
    import rclpy

    stranger = rclpy.create_node('stranger', namespace='stereo', context=intruder)
    stranger.create_publisher(PoseWithCovarianceStamped, 'left/centroid', 5)
    peer.wait_for(
        lambda: 'left/centroid has 2 publishers' in rig.status()[1], 'the second publisher'
    )
    level, message, _ = rig.status()
    stranger.destroy_node()
    assert level == DiagnosticStatus.WARN
    assert '/stereo/stranger' in message
    assert '/stereo/test_peer' in message


def test_an_override_of_one_topic_is_of_that_topic_alone(start, peer):
    """Its durability too; the best-effort cameras are heard still."""
    overrides = {
        'qos_overrides': {
            '/stereo/left/image_raw/compressed': {'subscription': {'reliability': 'reliable'}},
            '/stereo/left/centroid': {'publisher': {'durability': 'transient_local'}},
        }
    }
    start('detector', parameters={'detector': overrides}, reliable=False)
    infos = {}

    def found():
        for side in SIDES:
            topic = f'/stereo/{side}/image_raw/compressed'
            infos[side] = peer.node.get_subscriptions_info_by_topic(topic)
        infos['centroid'] = peer.node.get_publishers_info_by_topic('/stereo/left/centroid')
        return all(infos.values())

    peer.wait_for(found, 'the detector')
    reliability = {side: infos[side][0].qos_profile.reliability for side in SIDES}
    assert reliability['left'] == QoSReliabilityPolicy.RELIABLE
    assert reliability['right'] == QoSReliabilityPolicy.BEST_EFFORT
    assert infos['centroid'][0].qos_profile.durability == QoSDurabilityPolicy.TRANSIENT_LOCAL
    images = peer.node.create_publisher(CompressedImage, 'right/image_raw/compressed', SENSOR)
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    peer.connect(images)
    images.publish(CompressedImage(format='jpeg', data=b'no picture'))
    peer.wait_for(
        lambda: any(
            item.key == 'Received right/image_raw' and item.value == '1'
            for array in diagnostics
            for status in array.status
            for item in status.values
        ),
        'the image',
    )


def test_diagnostics_come_and_are_right_whatever_the_clock_does(start, peer):
    """Without a clock at all, and when it jumps back by a day, as that of a looping bag does."""
    rig = Triangulated(peer, start, {**IN_WATER, 'use_sim_time': True})
    peer.wait_for(lambda: rig.status()[2] != {}, 'a diagnostic without a clock')
    clock = peer.publisher(Clock, '/clock')
    rig.connect()
    for seconds in (1_700_086_400, 1_700_000_000):
        message = Clock()
        message.clock.sec = seconds
        clock.publish(message)
        before = len(rig.diagnostics)
        rig.feed(lambda before=before: len(rig.diagnostics) > before + 2, 'diagnostics')
    frequency = float(rig.status()[2]['Input frequency (Hz)'])
    assert 1.0 < frequency < 100.0


def test_two_suites_on_one_domain_are_told(start, peer):
    """They share the names of their topics and diagnostics."""
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    start('smoother')
    start('smoother')
    peer.wait_for(
        lambda: any(
            '2 nodes are called /stereo/smoother' in status.message
            and status.level == DiagnosticStatus.WARN
            for array in diagnostics
            for status in array.status
        ),
        'the warning',
    )
