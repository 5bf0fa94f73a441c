"""What `binopos doctor` says of machines that lack this and that."""

from __future__ import annotations

import ctypes
import re

import pytest

from binopos_ros.capture.errors import DENIED, CaptureError
from binopos_ros.capture.options import CaptureOptions, LeftOptions, RightOptions
from binopos_ros.capture.skew import Skew
from binopos_ros.capture.survey import Reached, Survey
from binopos_ros.capture.usb import Camera
from binopos_ros.capture.v4l2 import Format, Mode
from binopos_ros.cli import doctor, machine, main
from binopos_ros.cli.findings import FAULT, NOTE, OK, WARNING
from binopos_ros.detection import decoders
from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.camera_info_files import write_camera_info

LEFT = Camera('/dev/video0', 'Lab', 0, '1209:0001', 'S1', '3-1', bus=3, address=5)
RIGHT = Camera('/dev/video2', 'Lab', 0, '1209:0001', 'S2', '3-2', bus=3, address=6)
FORMAT = Format('MJPG', 1280, 720, 0, 0, 30.0)
GOOD = Reached(LEFT, FORMAT, 29.9, 0, 0, 120_000, '')
SKEW = Skew(0.2e-3, 0.4e-3, 3e-6, 60)


def told(findings):
    return [(one.level, str(one)) for one in findings]


def test_it_ends_well_on_a_machine_without_cameras(capsys, monkeypatch):
    monkeypatch.setattr(doctor.usb, 'find_cameras', list)
    assert main(['doctor']) == 0
    out = capsys.readouterr().out
    assert 'cameras: none found\n        -> plug one in' in out
    assert 'binopos doctor --config FILE' in out


def test_a_parameter_file_with_faults_is_one_line(capsys, tmp_path):
    path = tmp_path / 'rig.yaml'
    path.write_text('/**/camera: {ros__parameters: {lefft.device: S1}}')
    assert main(['doctor', '--config', str(path)]) == 2
    assert "did you mean 'left.device'" in capsys.readouterr().err


def test_a_rig_that_is_absent_is_a_fault(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(
        doctor,
        'survey',
        lambda *_: Survey(
            {'left': GOOD, 'right': Reached(None, None, 0.0, 0, 0, 0, 'not plugged in')}, None, 0
        ),
    )
    path = tmp_path / 'rig.yaml'
    path.write_text('/**/camera: {ros__parameters: {left.device: S1, left.controls.gain: 3}}')
    assert main(['doctor', '--config', str(path)]) == 1
    assert 'FAULT   right: not plugged in' in capsys.readouterr().out


def test_cameras_are_listed_with_what_they_offer(monkeypatch):
    modes = [
        Mode('MJPG', (640, 480), (640, 480), (1, 1), (30.0,)),
        Mode('MJPG', (1280, 720), (1280, 720), (1, 1), (30.0,)),
    ]

    def modes_of(camera):
        if camera is RIGHT:
            raise CaptureError('/dev/video2: this user may not', DENIED)
        return modes

    monkeypatch.setattr(doctor, 'modes_of', modes_of)
    metadata = Camera('/dev/video1', 'Lab', 1, '1209:0001', 'S1', '3-1')
    nameless = Camera('/dev/video4', 'Cheap', 0, '1209:0001', '', '3-3', bus=3)
    found = told(doctor.cameras([LEFT, metadata, RIGHT, nameless]))
    assert found[0] == (OK, f'ok      camera: {LEFT}: up to MJPG 1280x720 at 30 /s')
    assert found[1][0] == WARNING
    assert 'udevadm control --reload' in found[1][1]
    assert found[-1][0] == NOTE
    assert 'name it by its port, 3-3' in found[-1][1]
    assert len(found) == 4


@pytest.mark.parametrize(
    ('result', 'level', 'words'),
    [
        (Survey({'left': GOOD, 'right': GOOD}, SKEW, 0), OK, 'skew 0.20 ms in the median'),
        (
            Survey({'left': GOOD, 'right': GOOD}, Skew(0, 9e-3, float('nan'), 60), 2),
            NOTE,
            'a hardware trigger removes it',
        ),
        (Survey({'left': GOOD, 'right': GOOD}, None, 60), FAULT, 'raise pair_tolerance'),
        (
            Survey({'left': Reached(LEFT, FORMAT, 14.9, 3, 1, 9, '')}, SKEW, 0),
            WARNING,
            '14.90 of 30 frames/s, 3 lost, 1 damaged',
        ),
        (
            Survey(
                {'left': Reached(LEFT, Format('MJPG', 9, 9, 0, 0, 15.0), 15.0, 0, 0, 9, '')},
                SKEW,
                0,
            ),
            WARNING,
            'it has no 30 frames/s',
        ),
    ],
)
def test_what_the_rig_reaches_is_judged(monkeypatch, result, level, words):
    monkeypatch.setattr(doctor, 'survey', lambda *_: result)
    found = told(doctor.rig(CaptureOptions(), 1.0))
    assert any(each == level and words in text for each, text in found), found


def calibration(path, name, size=(1280, 720), shift=0.0):
    k = (900.0, 0.0, 640.0, 0.0, 900.0, 360.0, 0.0, 0.0, 1.0)
    p = (900.0, 0.0, 640.0, shift, 0.0, 900.0, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    write_camera_info(path, CameraInfo(name, *size, 'plumb_bob', (0.0,) * 5, k, p=p))
    return str(path)


def test_calibrations_are_checked_against_the_cameras(tmp_path):
    left = calibration(tmp_path / 'l.yaml', 'left_S1')
    right = calibration(tmp_path / 'r.yaml', 'right_S2', shift=-900.0 * 0.23)
    small = calibration(tmp_path / 's.yaml', 'left', (640, 360))
    reached = {'left': GOOD, 'right': Reached(RIGHT, FORMAT, 30.0, 0, 0, 9, '')}

    def check(left_url, right_url, sides=reached):
        options = CaptureOptions(
            left=LeftOptions(camera_info_url=left_url),
            right=RightOptions(camera_info_url=right_url),
        )
        return told(doctor.calibration(options, sides))

    assert check(left, right) == [(OK, 'ok      calibration: both present, baseline 0.23 m')]
    (exchanged,) = check(right, left)
    assert exchanged[0] == FAULT
    assert 'exchange the two files' in exchanged[1]
    swapped = {'left': reached['right'], 'right': reached['left']}
    assert [level for level, _ in check(left, right, swapped)] == [FAULT, FAULT]
    assert any('640x360' in text and level == FAULT for level, text in check(small, right))
    missing = check('', str(tmp_path / 'absent.yaml'))
    assert [level for level, _ in missing] == [WARNING, FAULT]


def test_ros_is_judged_by_its_environment():
    full = {'AMENT_PREFIX_PATH': '/opt/ros/jazzy', 'ROS_DISTRO': 'jazzy'}
    (fine,) = machine.ros(full)
    assert fine.level == OK
    (far,) = machine.ros({**full, 'ROS_DOMAIN_ID': '180'})
    assert far.level == FAULT
    (bare,) = machine.ros({})
    assert bare.level == NOTE


def test_large_raw_images_want_the_profile(tmp_path):
    small = told(machine.transport({}, 0, str(tmp_path)))
    assert small[0] == (OK, 'ok      DDS profile: not needed: the images fit')
    large = told(machine.transport({'ROS_DISTRO': 'jazzy'}, 3_700_000, str(tmp_path)))
    assert large[0][0] == NOTE
    assert 'FASTRTPS_DEFAULT_PROFILES_FILE' in large[0][1]
    absent = {'FASTRTPS_DEFAULT_PROFILES_FILE': str(tmp_path / 'absent.xml')}
    assert told(machine.transport(absent, 3_700_000, str(tmp_path)))[0][0] == FAULT
    other = {'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}
    assert [level for level, _ in told(machine.transport(other, 3_700_000, '/nowhere'))] == [OK]
    assert told(machine.transport({}, 0, '/nowhere'))[-1][0] == FAULT


def test_the_decoder_is_named_with_what_a_frame_costs(monkeypatch):
    ((level, text),) = told(machine.decoding(320, 240))
    assert level == OK
    assert decoders.JPEG_DECODER in ('simplejpeg', 'libjpeg-turbo')
    cost = r', [0-9.]+ ms for a frame of 320 x 240'
    assert re.search(f'JPEG decoder: {decoders.JPEG_DECODER}{cost}', text)
    monkeypatch.setattr(decoders, 'REMEDY', 'pip install simplejpeg')
    assert told(machine.decoding(320, 240))[0][0] == WARNING


@pytest.mark.parametrize(
    ('state', 'level', 'words'),
    [
        (0, OK, 'synchronised, to 12 ms at worst'),
        (5, WARNING, 'chrony'),
        (-1, NOTE, 'does not tell'),
    ],
)
def test_the_clocks_state_is_the_kernels(state, level, words):
    def adjtimex(answer):
        ctypes.c_long.from_buffer(answer, 24).value = 12_000
        return state

    ((found, text),) = told(machine.clock(adjtimex))
    assert found == level
    assert words in text


def test_the_right_to_reset_is_that_of_the_usb_node(tmp_path):
    (finding,) = machine.reset(LEFT, str(tmp_path))
    assert finding.level == WARNING
    assert '99-binopos-cameras.rules' in finding.remedy
    (finding,) = machine.reset(Camera('/dev/video9', 'vivid'), str(tmp_path))
    assert finding.level == NOTE
    node = tmp_path / 'dev/bus/usb/003/005'
    node.parent.mkdir(parents=True)
    node.write_bytes(b'')
    (finding,) = machine.reset(LEFT, str(tmp_path))
    assert 'libusb' in str(finding) or finding.level == OK
