"""The right camera's stage in a process of its own: what it says, and what ends it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.detection import DetectorOptions, JpegImage, RawImage
from binopos_ros.detection.apart import StageApart
from binopos_ros.detection.stage import CameraStage
from binopos_ros.optics import CameraInfo

PATIENCE = 20.0


def picture(k: int, size: tuple[int, int] = (320, 240)) -> np.ndarray:
    """A red disc that moves from picture to picture, (height, width, 3), blue-green-red."""
    noise = np.random.default_rng(k).normal(0, 1, (size[1], size[0], 3))
    bgr = np.clip(120 + noise, 0, 255).astype(np.uint8)
    cv2.circle(bgr, (16 * 120 + 30 * k, 16 * 100 + 7 * k), 16 * 20, (40, 40, 210), -1, 16, 4)
    return bgr


def jpeg(k: int, size: tuple[int, int] = (320, 240)) -> JpegImage:
    return JpegImage(cv2.imencode('.jpg', picture(k, size))[1].tobytes())


def raw(k: int, size: tuple[int, int]) -> RawImage:
    return RawImage(picture(k, size).tobytes(), size[0], size[1], 3 * size[0], 'bgr8')


@pytest.fixture
def apart() -> Iterator[StageApart]:
    stage = StageApart(DetectorOptions())
    yield stage
    stage.close()


def other_process() -> int:
    """The process id of the one child of this process that is a stage apart."""
    tasks = Path('/proc/self/task').iterdir()
    children = [int(pid) for task in tasks for pid in (task / 'children').read_text().split()]
    (found,) = (pid for pid in children if 'serve' in Path(f'/proc/{pid}/cmdline').read_text())
    return found


def test_it_says_what_a_stage_says_of_pictures_of_any_size_one_after_another(apart):
    stage = CameraStage(DetectorOptions())
    images = [jpeg(k) for k in range(15)]
    # Larger ones than any before take new memory, while the last may still be looked over.
    images += [raw(40, (320, 240)), jpeg(41, (1600, 1200)), raw(42, (1600, 1200)), jpeg(43)]
    images += [JpegImage(b''), replace(raw(44, (320, 240)), encoding='mono8'), jpeg(45)]
    for k, image in enumerate(images):
        apart.begin(k + 1, image)
        expected = stage.detect(k + 1, stage.prepare(image))
        stage.look_over()
        found = apart.end()
        assert found.reason == expected.reason
        if expected.target is not None:
            np.testing.assert_array_equal(found.target.centre, expected.target.centre)
            np.testing.assert_array_equal(found.target.covariance, expected.target.covariance)
            assert found.tracked == expected.tracked


def test_options_and_calibration_reach_it_and_the_process_after_it(apart):
    matrix = (500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0)
    apart.set_camera(CameraInfo('right', 640, 480, 'plumb_bob', (0.0,) * 5, matrix))
    apart.configure(DetectorOptions(track=False))
    for stamp in (1, 4):
        apart.begin(stamp, jpeg(0))
        assert 'its camera_info is for 640 x 480' in apart.end().reason
        for k, size in enumerate(((640, 480), (640, 480)), 1):
            apart.begin(stamp + k, jpeg(k, size))
            found = apart.end()
            assert found.target is not None
            assert not found.tracked
        if stamp == 1:
            os.kill(other_process(), signal.SIGKILL)
            apart.begin(10, jpeg(0))
            assert 'was killed by signal 9' in apart.end().reason


@pytest.mark.parametrize(
    ('number', 'told'), [(signal.SIGKILL, 'was killed by signal 9'), (signal.SIGSTOP, 'stopped')]
)
def test_a_process_that_ends_or_hangs_costs_one_picture_and_is_replaced(apart, number, told):
    apart.begin(1, jpeg(1))
    assert apart.end().target is not None
    os.kill(other_process(), number)
    apart.begin(2, jpeg(2))
    lost = apart.end()
    assert lost.target is None
    assert told in lost.reason
    apart.begin(3, jpeg(3))
    assert apart.end().target is not None


class Circles(str):
    """Sends whoever reads it from a socket round in circles."""

    def __reduce__(self):
        return exec, ('while True: pass',)


def test_a_process_that_runs_in_circles_costs_one_picture_and_is_replaced(apart, monkeypatch):
    apart.begin(1, jpeg(1))
    assert apart.end().target is not None
    with monkeypatch.context() as patched:
        patched.setattr('binopos_ros.detection.apart.CIRCLING', 0.4)
        apart.begin(2, replace(raw(2, (320, 240)), encoding=Circles('bgr8')))
        lost = apart.end()
    assert lost.target is None
    assert 'was busy for' in lost.reason
    apart.begin(3, jpeg(3))
    assert apart.end().target is not None


def test_it_ends_with_the_process_that_has_started_it():
    stage = StageApart(DetectorOptions())
    stage.begin(1, jpeg(1))
    stage.end()
    pid = other_process()
    stage._link.close()
    deadline = time.monotonic() + PATIENCE
    while Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z':
        assert time.monotonic() < deadline, 'it lives on'
        time.sleep(0.01)
    stage.close()
