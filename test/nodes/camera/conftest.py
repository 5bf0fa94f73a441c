"""Two cameras in a fake kernel, and the camera node on them."""

from __future__ import annotations

import gc
import threading
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import fake_kernel as fakes

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from binopos_ros.capture import kernel as v4l2  # noqa: E402
from binopos_ros.capture.usb import Camera  # noqa: E402
from binopos_ros.node_options import Parameters  # noqa: E402
from binopos_ros.nodes.camera import CameraNode  # noqa: E402
from binopos_ros.nodes.running import overrides  # noqa: E402
from binopos_ros.optics.camera_info import CameraInfo  # noqa: E402
from binopos_ros.optics.camera_info_files import write_camera_info  # noqa: E402


class Rig:
    """Two cameras in a fake kernel, and the node on them."""

    width, height = 64, 48
    left = Camera('/dev/video0', 'Lab', 0, '1209:0001', 'S1', '3-1')
    right = Camera('/dev/video2', 'Lab', 0, '1209:0001', 'S2', '3-2')

    def __init__(self):
        self.cameras = {
            self.left: self.make(self.jpeg(self.picture('left'))),
            self.right: self.make(self.jpeg(self.picture('right'))),
        }
        self.kernel = fakes.FakeKernel({one.node: fake for one, fake in self.cameras.items()})
        self.kernel.buffer_size = 1 << 15
        self.plugged = dict(self.cameras)
        self.node = self.thread = self.executor = None

    @staticmethod
    def jpeg(picture):
        return cv2.imencode('.jpg', picture)[1].tobytes()

    @classmethod
    def picture(cls, side):
        image = np.full((cls.height, cls.width, 3), 40 if side == 'left' else 200, np.uint8)
        image[10:20, 10:20] = (0, 0, 255)
        return image

    @classmethod
    def make(cls, data):
        one, both = (cls.width, cls.height), (2 * cls.width, cls.height)
        menu = {1: 'Manual Mode', 3: 'Aperture Priority Mode'}
        return fakes.FakeCamera(
            modes={'MJPG': {one: (30,), both: (30,)}, 'YUYV': {one: (30,)}},
            controls=[
                fakes.FakeControl(0x980913, 'Gain', maximum=95, step=5, default=35),
                fakes.FakeControl(
                    0x9A0901, 'Auto Exposure', v4l2.CTRL_TYPE_MENU, 0, 3, 1, 3, menu=menu
                ),
                fakes.FakeControl(0x9A0902, 'Exposure Time, Absolute', minimum=1, maximum=5000),
            ],
            live=30.0,
            picture=data,
        )

    def start(self, **parameters):
        words = []
        size = {'width': self.width, 'height': self.height}
        base = {'left.device': 'S1', 'right.device': 'S2', 'frame_timeout': 0.2, **size}
        for name, value in {**base, **parameters}.items():
            if value is not None:
                words += [
                    '-p',
                    f'camera:{name}:={str(value).lower() if value in (True, False) else value}',
                ]
        given = overrides(Parameters(words=words).given('camera'))
        rclpy.init(args=[])
        self.node = CameraNode(self.kernel, lambda: list(self.plugged), parameter_overrides=given)
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
        # A node that refused to start lives on in its exception's frames, and would stand in the
        # graph as a second one of this name in the tests that follow.
        gc.collect()


@pytest.fixture
def rig(ros_domain, tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_HOME', str(tmp_path / 'ros_home'))
    rig = Rig()
    yield rig
    rig.stop()
    assert rig.kernel.leaks == {'descriptors': 0, 'mappings': 0, 'streams': 0}


@pytest.fixture
def call(peer):
    """Call a service: call(SetBool, 'stop_capture', request)."""

    def answer(kind, name, request):
        client = peer.node.create_client(kind, f'/stereo/{name}')
        peer.wait_for(client.service_is_ready, name)
        future = client.call_async(request)
        peer.wait_for(future.done, f'the answer of {name}')
        return future.result()

    return answer


@pytest.fixture
def set_parameter(call):
    """Set a parameter of the node, and get the result."""

    def change(name, value):
        message = Parameter(name, value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[message])
        return call(SetParameters, 'camera/set_parameters', request).results[0]

    return change


@pytest.fixture
def diagnosed(peer):
    """What the node's newest diagnostics say: `diagnosed().level`, `.message`, `.values`."""
    arrays = peer.listen(DiagnosticArray, '/diagnostics')

    def newest():
        for array in reversed(arrays):
            for status in array.status:
                if 'camera' in status.name:
                    values = {item.key: item.value for item in status.values}
                    return SimpleNamespace(
                        level=status.level, message=status.message, values=values
                    )
        return SimpleNamespace(level=None, message='', values={})

    return newest


@pytest.fixture
def calibration(tmp_path):
    """Write a calibration file for a side, and give its path."""

    def write(side, size=(Rig.width, Rig.height)):
        shift = {'left': 0.0, 'right': -50.0 * 0.23}[side]
        k = (50.0, 0.0, size[0] / 2, 0.0, 50.0, size[1] / 2, 0.0, 0.0, 1.0)
        p = (50.0, 0.0, size[0] / 2, shift, 0.0, 50.0, size[1] / 2, 0.0, 0.0, 0.0, 1.0, 0.0)
        path = tmp_path / f'{side}_{size[0]}.yaml'
        write_camera_info(
            path, CameraInfo(side, *size, 'plumb_bob', (0.1, 0.0, 0.0, 0.0, 0.0), k, p=p)
        )
        return str(path)

    return write
