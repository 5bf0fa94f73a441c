"""The camera node on cameras in a fake kernel: what it publishes, and that it stays up."""

from __future__ import annotations

import importlib.util
import sys
import threading
import time
import tracemalloc
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rcl_interfaces.srv import DescribeParameters, SetParameters  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import CameraInfo, CompressedImage, Image  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402

from binopos_ros.capture import CaptureError  # noqa: E402
from binopos_ros.capture import kernel as v4l2  # noqa: E402
from binopos_ros.capture.usb import Camera  # noqa: E402
from binopos_ros.capture.v4l2 import Format  # noqa: E402
from binopos_ros.nodes import camera as camera_module  # noqa: E402
from binopos_ros.nodes.camera import CameraNode  # noqa: E402
from binopos_ros.optics.camera_info import CameraInfo as Calibration  # noqa: E402
from binopos_ros.optics.camera_info import write_camera_info  # noqa: E402

_path = Path(__file__).parent.parent / 'capture' / 'fake_kernel.py'
_spec = importlib.util.spec_from_file_location('fake_kernel_of_nodes', _path)
fakes = sys.modules['fake_kernel_of_nodes'] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(fakes)

WIDTH, HEIGHT = 64, 48
LEFT = Camera('/dev/video0', 'Lab', 0, '1209:0001', 'S1', '3-1')
RIGHT = Camera('/dev/video2', 'Lab', 0, '1209:0001', 'S2', '3-2')
BASE = {
    'left.device': 'S1',
    'right.device': 'S2',
    'width': WIDTH,
    'height': HEIGHT,
    'frame_timeout': 0.2,
}


def jpeg(picture):
    return cv2.imencode('.jpg', picture)[1].tobytes()


def picture(side, width=WIDTH):
    image = np.full((HEIGHT, width, 3), 40 if side == 'left' else 200, np.uint8)
    image[10:20, 10:20] = (0, 0, 255)
    return image


class Rig:
    """Two cameras in a fake kernel, and the node on them."""

    def __init__(self):
        self.cameras = {
            LEFT: self.make(jpeg(picture('left'))),
            RIGHT: self.make(jpeg(picture('right'))),
        }
        self.kernel = fakes.FakeKernel({one.node: fake for one, fake in self.cameras.items()})
        self.kernel.buffer_size = 1 << 15
        self.plugged = dict(self.cameras)
        self.node = self.thread = self.executor = None

    @staticmethod
    def make(data):
        camera = fakes.FakeCamera(
            modes={
                'MJPG': {(WIDTH, HEIGHT): (30,), (2 * WIDTH, HEIGHT): (30,)},
                'YUYV': {(WIDTH, HEIGHT): (30,)},
            },
            controls=[
                fakes.FakeControl(0x980913, 'Gain', maximum=95, step=5, default=35),
                fakes.FakeControl(
                    0x9A0901,
                    'Auto Exposure',
                    v4l2.CTRL_TYPE_MENU,
                    0,
                    3,
                    1,
                    3,
                    menu={1: 'Manual Mode', 3: 'Aperture Priority Mode'},
                ),
                fakes.FakeControl(0x9A0902, 'Exposure Time, Absolute', minimum=1, maximum=5000),
            ],
            live=30.0,
            picture=data,
        )
        return camera

    def start(self, **parameters):
        words = ['--ros-args']
        for name, value in {**BASE, **parameters}.items():
            if value is not None:
                words += [
                    '-p',
                    f'{name}:={str(value).lower() if value in (True, False) else value}',
                ]
        rclpy.init(args=words)
        self.node = CameraNode(self.kernel, lambda: list(self.plugged))
        self.executor = rclpy.executors.SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self.executor.spin)
        self.thread.start()
        return self.node

    def unplug(self, camera):
        self.plugged.pop(camera)
        self.cameras[camera].gone = True

    def plug(self, camera):
        fake = self.cameras[camera]
        fake.gone = fake.streaming = False
        fake.__dict__['memory'] = {}
        self.plugged[camera] = fake

    def stop(self):
        if self.executor is not None:
            self.executor.shutdown()
            self.thread.join(10.0)
            self.node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture
def rig(ros_domain, tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros_home'))
    rig = Rig()
    yield rig
    rig.stop()
    assert rig.kernel.leaks == {'descriptors': 0, 'mappings': 0, 'streams': 0}


def values_of(messages):
    """The newest diagnostics of the camera node: level, message, values."""
    for array in reversed(messages):
        for status in array.status:
            if 'camera' in status.name:
                return status, {item.key: item.value for item in status.values}
    return None, {}


def call(peer, kind, name, request):
    client = peer.node.create_client(kind, f'/stereo/{name}')
    peer.wait_for(client.service_is_ready, name)
    future = client.call_async(request)
    peer.wait_for(future.done, f'the answer of {name}')
    return future.result()


def set_parameter(peer, name, value):
    message = Parameter(name, value=value).to_parameter_msg()
    request = SetParameters.Request(parameters=[message])
    return call(peer, SetParameters, 'camera/set_parameters', request).results[0]


def calibration(path, side, size=(WIDTH, HEIGHT), baseline=None):
    shift = {'left': 0.0, 'right': -50.0 * 0.23}[side] if baseline is None else baseline
    k = (50.0, 0.0, size[0] / 2, 0.0, 50.0, size[1] / 2, 0.0, 0.0, 1.0)
    p = (50.0, 0.0, size[0] / 2, shift, 0.0, 50.0, size[1] / 2, 0.0, 0.0, 0.0, 1.0, 0.0)
    info = Calibration(side, *size, 'plumb_bob', (0.1, 0.0, 0.0, 0.0, 0.0), k, p=p)
    write_camera_info(path, info)
    return str(path)


def test_jpegs_go_through_untouched_with_the_time_of_their_taking(rig, peer, tmp_path):
    images = {
        side: peer.listen(CompressedImage, f'{side}/image_raw/compressed')
        for side in ('left', 'right')
    }
    infos = peer.listen(CameraInfo, 'left/camera_info')
    began = time.time()
    rig.start(
        **{
            'left.camera_info_url': 'file://' + calibration(tmp_path / 'left.yaml', 'left'),
            'right.camera_info_url': calibration(tmp_path / 'right.yaml', 'right'),
        }
    )
    peer.wait_for(lambda: all(len(got) >= 5 for got in images.values()) and infos, 'images')
    ended = time.time()
    for side, camera in (('left', LEFT), ('right', RIGHT)):
        for message in images[side]:
            assert bytes(message.data) == rig.cameras[camera].picture
            assert message.format == 'jpeg'
            assert message.header.frame_id == f'{side}_camera_optical_frame'
            assert began <= message.header.stamp.sec + message.header.stamp.nanosec * 1e-9 <= ended
    assert list(infos[0].k)[:3] == [50.0, 0.0, WIDTH / 2]
    stamps = {(one.header.stamp.sec, one.header.stamp.nanosec) for one in images['left']}
    assert stamps & {(one.header.stamp.sec, one.header.stamp.nanosec) for one in infos}


def test_raw_images_keep_their_bytes(rig, peer):
    pixels = bytes(np.random.default_rng(0).integers(0, 256, 2 * WIDTH * HEIGHT, np.uint8))
    for camera in rig.cameras.values():
        camera.picture = pixels
    images = peer.listen(Image, 'left/image_raw')
    rig.start(pixel_format='YUYV')
    peer.wait_for(lambda: images, 'an image')
    message = images[0]
    assert (message.width, message.height, message.step) == (WIDTH, HEIGHT, 2 * WIDTH)
    assert message.encoding == 'yuv422_yuy2'
    assert bytes(message.data) == pixels


def test_a_side_by_side_stream_is_split(rig, peer):
    whole = np.hstack([picture('left'), picture('right')])
    rig.cameras[LEFT].picture = jpeg(whole)
    images = {side: peer.listen(Image, f'{side}/image_raw') for side in ('left', 'right')}
    rig.start(side_by_side=True, width=2 * WIDTH)
    peer.wait_for(lambda: all(images.values()), 'both halves')
    for side, got in images.items():
        message = got[0]
        assert (message.width, message.height, message.encoding) == (WIDTH, HEIGHT, 'bgr8')
        shown = np.frombuffer(message.data, np.uint8).reshape(HEIGHT, WIDTH, 3)
        difference = cv2.absdiff(shown, picture(side))
        assert np.median(difference) <= 2
    stamps = [images[side][0].header.stamp for side in images]
    assert stamps[0] == stamps[1]


def test_a_lost_camera_is_told_and_comes_back_while_the_other_goes_on(rig, peer):
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rights = peer.listen(CompressedImage, 'right/image_raw/compressed')
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    rig.start()
    peer.wait_for(lambda: lefts and rights, 'images')
    rig.unplug(RIGHT)
    peer.wait_for(
        lambda: 'is unplugged; plug it in again'
        in getattr(values_of(diagnostics)[0], 'message', ''),
        'the word of the loss',
    )
    status, values = values_of(diagnostics)
    assert status.level == b'\x02'
    assert values['right: state'] == 'lost'
    assert values['left: state'] == 'streaming'
    count = len(lefts)
    peer.wait_for(lambda: len(lefts) > count + 3, 'further left images')
    rights.clear()
    rig.plug(RIGHT)
    peer.wait_for(lambda: len(rights) > 3, 'right images again')
    peer.wait_for(lambda: values_of(diagnostics)[0].level == b'\x00', 'the all-clear')
    values = values_of(diagnostics)[1]
    assert values['right: losses'] == '1 gone'
    assert float(values['right: last recovery (s)']) <= float(values['right: last outage (s)'])
    assert int(values['Pairs']) > 0
    assert 'Pair skew, median (ms)' in values


def test_a_camera_missing_at_the_start_is_taken_up_with_its_controls(rig, peer):
    rig.unplug(RIGHT)
    rights = peer.listen(CompressedImage, 'right/image_raw/compressed')
    node = rig.start(**{'right.controls.gain': 45})
    rig.plug(RIGHT)
    peer.wait_for(lambda: rights, 'right images')
    assert rig.cameras[RIGHT].controls[0].value == 45
    peer.wait_for(lambda: node.has_parameter('right.controls.auto_exposure'), 'the controls')
    assert node.get_parameter('right.controls.gain').value == 45


def test_a_control_that_a_late_camera_does_not_take_is_left_alone(rig, peer):
    rig.unplug(RIGHT)
    rights = peer.listen(CompressedImage, 'right/image_raw/compressed')
    rig.start(**{'right.controls.gain': 999})
    rig.plug(RIGHT)
    peer.wait_for(lambda: rights, 'right images')
    assert rig.cameras[RIGHT].controls[0].value == 35


def test_damaged_jpegs_are_dropped_with_the_reason(rig, peer):
    whole = rig.cameras[LEFT].picture
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    rig.start()
    peer.wait_for(lambda: lefts, 'images')
    rig.cameras[LEFT].picture = whole[: len(whole) // 2]
    peer.wait_for(
        lambda: int(values_of(diagnostics)[1].get('Dropped: left: JPEG cut short', 0)) > 0,
        'the drops',
    )
    rig.cameras[LEFT].picture = b'\0\0' + whole
    peer.wait_for(
        lambda: int(values_of(diagnostics)[1].get('Dropped: left: not a JPEG', 0)) > 0, 'the drops'
    )
    assert all(bytes(message.data) == whole for message in lefts)


def test_controls_are_parameters_with_their_range_and_menu(rig, peer):
    rig.start(**{'left.controls.gain': 40})
    left, right = rig.cameras.values()
    assert left.controls[0].value == 40
    assert right.controls[0].value == 35
    names = ['left.controls.gain', 'left.controls.auto_exposure']
    gain, exposure = call(
        peer,
        DescribeParameters,
        'camera/describe_parameters',
        DescribeParameters.Request(names=names),
    ).descriptors
    assert (gain.integer_range[0].from_value, gain.integer_range[0].to_value) == (-1, 95)
    assert '1: Manual Mode, 3: Aperture Priority Mode' in exposure.description
    assert set_parameter(peer, 'left.controls.gain', 60).successful
    assert left.controls[0].value == 60
    refused = set_parameter(peer, 'left.controls.gain', 61)
    assert not refused.successful
    assert 'steps of 5' in refused.reason
    assert set_parameter(peer, 'left.controls.gain', -1).successful
    assert left.controls[0].value == 60


def test_exposure_and_gain_are_kept_equal(rig, peer):
    node = rig.start(lock_exposure=True)
    left, right = rig.cameras.values()
    left.controls[0].value, left.controls[2].value = 70, 1234
    peer.wait_for(
        lambda: (right.controls[0].value, right.controls[2].value) == (70, 1234), 'equality'
    )
    assert right.controls[1].value == 1
    assert left.controls[1].value == 3
    assert node.get_parameter('lock_exposure').value


def test_capture_stops_and_starts_by_service(rig, peer):
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rig.start()
    peer.wait_for(lambda: lefts, 'images')
    answer = call(peer, SetBool, 'stop_capture', SetBool.Request(data=True))
    assert (answer.success, answer.message) == (True, 'stopped')
    assert rig.kernel.leaks == {'descriptors': 0, 'mappings': 0, 'streams': 0}
    lefts.clear()
    answer = call(peer, SetBool, 'start_capture', SetBool.Request(data=True))
    assert (answer.success, answer.message) == (True, 'capturing')
    peer.wait_for(lambda: lefts, 'images again')


def test_the_stamp_offset_changes_at_run_time(rig, peer):
    lefts = peer.listen(CompressedImage, 'left/image_raw/compressed')
    rig.start()
    assert set_parameter(peer, 'timestamp_offset', -5.0).successful
    peer.wait_for(lambda: lefts and time.time() - lefts[-1].header.stamp.sec > 4.0, 'the offset')
    assert not set_parameter(peer, 'width', 32).successful


def test_an_exchange_since_the_last_run_is_noticed(rig, peer):
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    rig.start(**{'left.device': '/dev/video0', 'right.device': '/dev/video2'})
    peer.wait_for(lambda: values_of(diagnostics)[0] is not None, 'diagnostics')
    peer.wait_for(lambda: camera_module.recall(camera_module.memory_file()), 'the memory')
    rig.stop()
    rig.plugged = {
        replace(LEFT, node='/dev/video2'): None,
        replace(RIGHT, node='/dev/video0'): None,
    }
    diagnostics.clear()
    rig.start(**{'left.device': '/dev/video0', 'right.device': '/dev/video2'})
    peer.wait_for(
        lambda: 'left and right have changed places'
        in getattr(values_of(diagnostics)[0], 'message', ''),
        'the word of the exchange',
    )


@pytest.mark.parametrize(
    ('parameters', 'words'),
    [
        ({'right.device': 'S1'}, "are both 'S1': name two cameras"),
        ({'right.device': '/dev/video0'}, 'which the other side has: name two'),
        ({'width': 320}, 'no MJPG 320x48; it offers MJPG 64x48'),
        ({'pixel_format': 'H264'}, "pixel_format 'H264' cannot be passed on; choose one of MJPG"),
        ({'left.controls.gain': 96}, 'gain = 96 is out of range: it takes 0 to 95'),
        ({'left.controls.zoom': 3}, "no control 'zoom'; its controls are gain"),
        ({'frame_timeout': 0.0}, 'frame_timeout'),
        ({'left.camera_info_url': '/absent.yaml'}, '/absent.yaml'),
        ({'left.camera_info_url': 'package://no_such_package/a.yaml'}, 'no_such_package'),
        ({'left.camera_info_url': 'http://somewhere/a.yaml'}, 'give file://PATH'),
        ({'lefft.device': 'S1'}, "did you mean 'left.device'"),
    ],
)
def test_bad_input_is_refused_in_one_line(rig, parameters, words):
    with pytest.raises(ValueError, match=r'\w') as caught:
        rig.start(**parameters)
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_calibration_of_another_camera_is_refused(rig, tmp_path):
    left = calibration(tmp_path / 'left.yaml', 'left')
    right = calibration(tmp_path / 'right.yaml', 'right')
    for urls, words in (
        (
            (calibration(tmp_path / 'big.yaml', 'left', (640, 480)), right),
            'is for images of 640x480',
        ),
        ((right, left), 'exchange the two files'),
        ((left, left), 'hold no baseline'),
        ((right, right), 'calibration of a right camera'),
    ):
        with pytest.raises(CaptureError, match=words):
            rig.start(**{'left.camera_info_url': urls[0], 'right.camera_info_url': urls[1]})
        rclpy.try_shutdown()


@pytest.mark.parametrize('pixel_format', ['MJPG', 'YUYV'])
def test_from_the_drivers_buffer_to_the_message_there_is_one_copy(pixel_format):
    form = Format(pixel_format, 1280, 960, 2560 if pixel_format == 'YUYV' else 0, 0, 30.0)
    buffer = memoryview(bytearray(1280 * 960 * 2))
    camera_module._messages(buffer, form)
    tracemalloc.start()
    try:
        (message,) = camera_module._messages(buffer, form)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(message.data) == len(buffer)
    assert len(buffer) <= most < 1.1 * len(buffer)


def test_each_half_of_a_raw_side_by_side_image_is_copied_once():
    form = Format('YUYV', 2560, 960, 5120 + 64, 0, 30.0)
    buffer = memoryview(bytearray(form.step * form.height))
    tracemalloc.start()
    try:
        left, right = camera_module._split_messages(buffer, form)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert (left.width, left.step, len(right.data)) == (1280, 2560, 2560 * 960)
    assert 2 * len(left.data) <= most < 2.1 * len(left.data)
