"""`binopos calibrate ... --live` as a process, fed with pictures over ROS topics."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import stamp_of
from binopos_ros.calibration.views.pairs import CELLS
from binopos_ros.cli import main
from binopos_ros.optics import read_camera_info
from binopos_ros.sides import SIDES

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

pytestmark = pytest.mark.live

#: Only a failure waits as long as this (s).
PATIENCE = 240.0
Jpegs = tuple[bytes, bytes]


class Taking:
    """The verb as a process, and the cameras that it looks through."""

    def __init__(self, node: Any, *words: str) -> None:
        from sensor_msgs.msg import CompressedImage

        self.message_type = CompressedImage
        self.executor = rclpy.executors.SingleThreadedExecutor(context=node.context)
        self.executor.add_node(node)
        self.cameras = {
            side: node.create_publisher(CompressedImage, f'{side}/image_raw/compressed', 10)
            for side in SIDES
        }
        self.overlays: list[Any] = []
        node.create_subscription(
            CompressedImage, 'calibration/overlay/compressed', self.overlays.append, 50
        )
        self.end = time.monotonic() + PATIENCE
        self.stamp = 1_000_000_000_000
        self.process = subprocess.Popen(
            [sys.executable, '-u', '-m', 'binopos_ros', 'calibrate', *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        # Pipes are read all the time: a full one would stop the verb.
        self.said: dict[str, list[str]] = {'out': [], 'err': []}
        self.readers = [
            threading.Thread(target=self.said[name].extend, args=(stream,), daemon=True)
            for name, stream in (('out', self.process.stdout), ('err', self.process.stderr))
        ]
        for reader in self.readers:
            reader.start()

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Let the node work until it holds."""
        while not condition():
            assert time.monotonic() < self.end, f'no {what}: {"".join(self.said["err"])}'
            self.executor.spin_once(timeout_sec=0.05)

    def connect(self) -> None:
        """Wait until both cameras have their listener."""
        self.wait_until(
            lambda: (
                self.process.poll() is not None
                or all(camera.get_subscription_count() for camera in self.cameras.values())
            ),
            'subscription',
        )

    def show(self, pair: Jpegs) -> None:
        """Hold one pair of pictures before the cameras until it was looked at twice, at rest."""
        first = self.stamp + 1
        published = 0.0

        def looked_at() -> bool:
            nonlocal published
            if self.process.poll() is not None:
                return True
            if time.monotonic() - published > 0.1:  # a camera's pace; lost ones come again
                published = time.monotonic()
                self._publish(pair)
            return sum(stamp_of(one) >= first for one in self.overlays) >= 2

        self.wait_until(looked_at, 'overlay')

    def _publish(self, pair: Jpegs) -> None:
        self.stamp += 100_000_000
        for side, jpeg in zip(SIDES, pair, strict=True):
            message = self.message_type(format='jpeg', data=jpeg)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(self.stamp, 10**9)
            self.cameras[side].publish(message)

    def finish(self) -> tuple[int, str, str]:
        """Wait for the verb's own end; exit status, stdout and stderr."""
        status = self.process.wait(PATIENCE)
        for reader in self.readers:
            reader.join(PATIENCE)
        return status, ''.join(self.said['out']), ''.join(self.said['err'])

    def overlay(self) -> np.ndarray:
        """The newest overlay, bgr."""
        return cv2.imdecode(np.frombuffer(self.overlays[-1].data, np.uint8), cv2.IMREAD_COLOR)


@pytest.fixture
def take(ros_domain: int) -> Iterator[Callable[..., Taking]]:
    """Starts the verb, with a node of the test's own in /stereo beside it."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('test_peer', namespace='stereo', context=context)
    started: list[Taking] = []

    def start(*words: str) -> Taking:
        started.append(Taking(node, *words))
        return started[-1]

    yield start
    for taking in started:
        taking.process.kill()
        taking.process.wait()
        taking.executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def is_a_terminal_view(output: str) -> None:
    """The last view in the terminal: a coverage map of both cameras, the standing, the hint."""
    lines = output.splitlines()
    row = max(i for i, line in enumerate(lines) if line.startswith('next: '))
    view = lines[row - 3 - CELLS[1] : row + 1]
    assert view[0].split() == ['left', 'right']
    for cells in view[1 : 1 + CELLS[1]]:
        assert len(cells) == 2 * 2 * CELLS[0] + 3
        assert set(cells) <= set(' ░▒▓█')
    assert any('█' in cells for cells in view[1 : 1 + CELLS[1]])
    assert view[-3].startswith(('taken', 'not taken: '))
    assert 'views, positions to' in view[-2]
    assert 'mm' in view[-2]


def test_stereo_live_ends_with_ctrl_c(
    take: Callable[..., Taking], samples: Path, tmp_path: Path
) -> None:
    words = ['--square', '0.025', '--wanted', '1e-6', '--distance', '0.4', '-o']
    taking = take('stereo', '--live', *words, str(tmp_path / 'cal'))
    taking.connect()
    for left in sorted(samples.glob('left0*.jpg')):
        right = left.with_name(left.name.replace('left', 'right'))
        taking.show((left.read_bytes(), right.read_bytes()))
    taking.process.send_signal(signal.SIGINT)
    status, output, errors = taking.finish()
    assert status == 0, errors
    is_a_terminal_view(output)
    assert 'hold it' in output
    assert 'held-out RMS' in output
    assert (tmp_path / 'cal' / 'left.yaml').is_file()
    assert (tmp_path / 'cal' / 'stereo.html').is_file()

    overlay = taking.overlay()
    assert overlay.shape == (480, 1280, 3)
    picture = np.hstack([cv2.imread(str(samples / f'{side}09.jpg')) for side in SIDES])
    greener = overlay[..., 1].astype(int) - picture[..., 1] > 15
    assert 0.05 < greener[:, :640].mean() < 0.95  # the covered part of the picture


@pytest.fixture(scope='module')
def wet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of boards in water, with the cameras' true calibration beside it."""
    bag = tmp_path_factory.mktemp('live') / 'wet'
    line = f'simulate -o {bag} --preset demo --board 9x6 --square 0.025 --pairs 9 --rate 2'
    assert main(line.split()) == 0
    return bag


def pictures_of(bag: Path) -> list[Jpegs]:
    """The JPEGs of a bag, pair by pair."""
    sides: dict[str, list[bytes]] = {side: [] for side in SIDES}
    with BagReader(bag) as reader:
        topics = [f'/stereo/{side}/image_raw/compressed' for side in SIDES]
        for record in reader.messages(topics=topics):
            sides[record.topic.split('/')[2]].append(bytes(reader.decode(record).data))
    return list(zip(sides['left'], sides['right'], strict=True))


def test_interface_live_ends_when_it_is_good_enough(
    take: Callable[..., Taking], wet: Path, tmp_path: Path
) -> None:
    words = f'--calibration {wet} --square 0.025 --wanted 0.004 --distance 1.1 -o {tmp_path}'
    taking = take('interface', '--live', *words.split())
    taking.connect()
    for pair in pictures_of(wet):
        taking.show(pair)
    status, output, errors = taking.finish()
    assert status == 0, errors
    is_a_terminal_view(output)
    assert 'good enough: stop here' in output
    assert 'The distance of the surface is determined' in output
    assert taking.overlay().shape == (480, 1280, 3)
    parameters = (tmp_path / 'interface.yaml').read_text()
    distance = float(parameters.split('distance: ')[1].split()[0])
    assert distance == pytest.approx(0.8, abs=0.01)
    assert read_camera_info(tmp_path / 'left.yaml').k == read_camera_info(wet / 'left.yaml').k


def test_live_without_pictures_says_what_to_look_at(take: Callable[..., Taking]) -> None:
    taking = take('stereo', '--live', '--square', '0.025')
    taking.connect()
    taking.process.send_signal(signal.SIGINT)
    status, _, errors = taking.finish()
    assert status == 2
    assert errors.splitlines()[-1].startswith('binopos calibrate: no view was taken')
    assert 'published under /stereo' in errors
