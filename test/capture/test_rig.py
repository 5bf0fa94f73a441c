"""Two cameras at work together, and the survey that `binopos doctor` makes of them."""

from __future__ import annotations

import copy
import threading

import pytest

from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture import recovery
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.options import CaptureOptions, LeftOptions, RightOptions
from binopos_ros.capture.recovery import STREAMING
from binopos_ros.capture.rig import CaptureRig
from binopos_ros.capture.survey import survey
from binopos_ros.capture.usb import Camera

LEFT = Camera('/dev/video0', 'Lab', 0, '1209:0001', 'S1', '3-1')
RIGHT = Camera('/dev/video2', 'Lab', 0, '1209:0001', 'S2', '3-2')
OPTIONS = CaptureOptions(
    left=LeftOptions(device='S1'), right=RightOptions(device='S2'), width=640, height=480
)
PATIENCE = 20.0


@pytest.fixture
def pair(kernel, camera):
    """Left and right, streaming by themselves 200 times a second."""
    camera.live = 200.0
    camera.modes['MJPG'][640, 480] = (200,)
    right = copy.deepcopy(camera)
    kernel.cameras[RIGHT.node] = right
    return camera, right


@pytest.fixture
def build(kernel, pair):
    rigs = []

    def make(options=OPTIONS, on_frame=lambda *_: None, settings=None):
        rigs.append(
            CaptureRig(
                options, on_frame, settings or {}, kernel=kernel, look=lambda: [LEFT, RIGHT]
            )
        )
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.stop()


def wait_for(condition):
    for _ in range(int(PATIENCE / 0.005)):
        if condition():
            return
        threading.Event().wait(0.005)
    pytest.fail('waited in vain')


def test_frames_of_both_sides_arrive_and_are_paired(build):
    seen = {'left': 0, 'right': 0}

    def count(side, frame, form):
        assert form.pixel_format == 'MJPG'
        seen[side] += len(frame.data) > 0

    rig = build(on_frame=count)
    assert rig.check() == {}
    rig.start()
    rig.start()
    wait_for(lambda: min(seen.values()) > 20 and rig.meter.paired > 5)
    assert set(rig.identities()) == {'left', 'right'}
    rig.stop()
    assert not rig.running


def test_stopping_right_after_the_start_is_no_trap(build):
    rig = build()
    for _ in range(20):
        rig.start()
        rig.stop()
    assert not rig.running


def test_two_names_for_one_camera_are_refused(build):
    options = CaptureOptions(
        left=LeftOptions(device='S1'),
        right=RightOptions(device='/dev/video0'),
        width=640,
        height=480,
    )
    with pytest.raises(CaptureError, match=r'/dev/video0.*, which the other side has'):
        build(options).check()


def test_a_bug_in_what_takes_the_frames_is_told_and_does_not_cost_the_camera(
    build, monkeypatch, caplog
):
    monkeypatch.setattr(recovery, 'LONGEST_PAUSE', 0.05)
    broken = True

    def fail(side, frame, form):
        if broken and side == 'left':
            raise ZeroDivisionError(side)

    rig = build(on_frame=fail)
    left, right = (rig.cameras[side].health for side in ('left', 'right'))
    rig.start()
    wait_for(lambda: 'ZeroDivisionError' in left.trouble and right.good)
    assert 'ZeroDivisionError' in caplog.text
    broken = False
    good = left.good
    wait_for(lambda: left.state == STREAMING and left.good > good + 3)
    assert left.trouble == ''


def test_equalising_copies_the_left_cameras_values(build, pair):
    rig = build()
    assert rig.equalise() == ''
    rig.start()
    wait_for(lambda: all(one.health.good for one in rig.cameras.values()))
    by_label = [{one.label: one for one in camera.controls} for camera in pair]
    by_label[0]['Gain'].value = 60
    by_label[1]['Exposure Time, Absolute'].flags = 0
    by_label[0]['Exposure Time, Absolute'].value = 99
    assert rig.equalise() == ''
    assert by_label[1]['Gain'].value == 60
    assert by_label[1]['Exposure Time, Absolute'].value == 99
    assert by_label[1]['Auto Exposure'].value == 1
    by_label[1]['Exposure Time, Absolute'].flags = v4l2.CTRL_FLAG_INACTIVE
    by_label[0]['Exposure Time, Absolute'].value = 98
    assert 'exposure not locked' in rig.equalise()


def test_a_survey_measures_rates_and_skew(kernel, pair):
    result = survey(OPTIONS, 0.5, kernel=kernel, look=lambda: [LEFT, RIGHT])
    for side in ('left', 'right'):
        reached = result.sides[side]
        assert reached.trouble == ''
        assert reached.rate == pytest.approx(200.0, rel=1e-3)
        assert reached.frame_bytes == len(pair[0].picture)
    assert result.skew.pairs > 0


def test_a_survey_tells_what_is_missing(kernel, pair):
    result = survey(OPTIONS, 0.05, kernel=kernel, look=lambda: [LEFT])
    assert "camera 'S2' is not plugged in" in result.sides['right'].trouble
    assert result.sides['right'].rate == 0.0
