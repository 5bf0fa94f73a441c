"""One check of a calibration, wherever it comes from: a file, a topic of a bag, a camera's."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from binopos_ros.calibration.report.files import write_stereo
from binopos_ros.capture.options import CaptureOptions, LeftOptions, RightOptions
from binopos_ros.cli import doctor
from binopos_ros.cli.findings import FAULT, OK, WARNING, Finding
from binopos_ros.optics import (
    CameraInfo,
    OpticsError,
    stereo_contradictions,
    stereo_from_camera_infos,
)
from binopos_ros.optics.camera_info_files import write_camera_info
from binopos_ros.optics.rig_state import Camera, RigState, exponential
from other_bags import Entry, rewritten
from verbs import process, used

SIZE = (1280, 720)
FOCAL = 900.0
LEFT = CameraInfo(
    'left',
    *SIZE,
    'plumb_bob',
    (0.0,) * 5,
    (FOCAL, 0.0, 640.0, 0.0, FOCAL, 360.0, 0.0, 0.0, 1.0),
    p=(FOCAL, 0.0, 640.0, 0.0, 0.0, FOCAL, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0),
)


def right(baseline: float, **changes: object) -> CameraInfo:
    p = (*LEFT.p[:3], -FOCAL * baseline, *LEFT.p[4:])
    return replace(LEFT, **{'name': 'right', 'p': p, **changes})


def diagnosed(folder: Path, left: CameraInfo, right_info: CameraInfo) -> list[Finding]:
    """What `doctor` says of two files."""
    for info, name in ((left, 'l.yaml'), (right_info, 'r.yaml')):
        write_camera_info(folder / name, info)
    options = CaptureOptions(
        left=LeftOptions(camera_info_url=str(folder / 'l.yaml')),
        right=RightOptions(camera_info_url=str(folder / 'r.yaml')),
    )
    return list(doctor.calibration(options, {}))


def test_a_sound_pair_is_well(tmp_path: Path) -> None:
    (found,) = diagnosed(tmp_path, LEFT, right(0.23))
    assert (found.level, found.text) == (OK, 'both present, baseline 0.23 m')


@pytest.mark.parametrize(
    ('left_info', 'right_info', 'says'),
    [
        (LEFT, right(230.0), '230 m, which no rig has'),
        (LEFT, right(23.0), '23 m, which no rig has'),
        (LEFT, right(0.00037), '0.00037 m, which no rig has'),
        (LEFT, right(0.0), 'hold no baseline'),
        (right(0.23), right(0.23), r'same P\[3\] = -207'),
        (right(0.23), LEFT, 'exchange the two files'),
        (LEFT, right(0.23, k=(-600.0, *LEFT.k[1:])), 'fx = -600'),
    ],
)
def test_what_cannot_be_is_a_fault_everywhere(
    tmp_path: Path, left_info: CameraInfo, right_info: CameraInfo, says: str
) -> None:
    with pytest.raises(OpticsError, match=says):
        stereo_from_camera_infos(left_info, right_info)
    found = diagnosed(tmp_path, left_info, right_info)
    assert any(each.level == FAULT and re.search(says, each.text) for each in found), found


def test_a_principal_point_outside_the_picture_is_a_fault(tmp_path: Path) -> None:
    twice = replace(LEFT, k=(*(2 * v for v in LEFT.k[:8]), 1.0))
    faults = [each for each in diagnosed(tmp_path, twice, right(0.23)) if each.level == FAULT]
    assert 'outside an image of 1280x720' in faults[0].text


def test_cameras_that_are_exchanged_are_told(tmp_path: Path) -> None:
    """Exchanged alike, cameras and calibrations give right positions; they are told all the same.

    So are the cameras of a real rig, whose left one is on the right (`openptv-multiplane`).
    """
    (found,) = diagnosed(tmp_path, LEFT, right(-0.23))
    assert found.level == FAULT
    assert '0.23 m to the left of the left one: exchange' in found.text
    assert stereo_contradictions(LEFT, right(0.23)) == []
    (told,) = stereo_contradictions(LEFT, right(-0.23))
    assert told == found.text


def test_binned_pictures_are_of_the_size_that_is_sent(tmp_path: Path) -> None:
    """A file for the whole sensor, with its binning, is for pictures of half the size."""
    whole = {'width': 2 * SIZE[0], 'height': 2 * SIZE[1], 'binning': (2, 2)}
    k = (*tuple(2 * v for v in LEFT.k[:8]), 1.0)
    found = diagnosed(tmp_path, replace(LEFT, **whole, k=k), right(0.23, **whole, k=k))
    assert [each.level for each in found] == [OK]
    twice = diagnosed(tmp_path, replace(LEFT, binning=(2, 2)), right(0.23, binning=(2, 2)))
    assert all(each.level == FAULT and '640x360' in each.text for each in twice)


@pytest.mark.parametrize(
    ('rotation', 'translation'),
    [
        ((0.02, 0.0, 0.0), (0.0, -0.2, 0.0)),
        ((0.02, 0.0, 0.0), (0.0, 0.2, 0.0)),
        ((0.0, 0.01, math.pi - 0.02), (0.15, 0.0, 0.0)),
    ],
    ids=['above', 'below', 'upside down'],
)
def test_a_vertical_rig_is_as_good_as_any(
    tmp_path: Path, rotation: tuple[float, ...], translation: tuple[float, ...]
) -> None:
    """P[7] holds the baseline where one camera is above the other, or hangs upside down."""
    cameras = (Camera(np.array([900.0, 901.0]), np.array([640.0, 360.0]), np.zeros(5), SIZE),) * 2
    state = RigState(cameras, exponential(np.array(rotation)), np.array(translation))
    write_stereo(tmp_path, state, np.eye(len(state.names)))
    options = CaptureOptions(
        left=LeftOptions(camera_info_url=str(tmp_path / 'left.yaml')),
        right=RightOptions(camera_info_url=str(tmp_path / 'right.yaml')),
    )
    (found,) = doctor.calibration(options, {})
    assert found.level == OK, found
    assert f'{np.linalg.norm(translation):.4g} m' in found.text


Change = Callable[[Any], None]


def in_bag(change: Change) -> Callable[[Entry], Entry]:
    def changed(entry: Entry) -> Entry:
        if entry.topic.endswith('camera_info'):
            entry.message.k, entry.message.p = entry.message.k.copy(), entry.message.p.copy()
            change(entry.message)
        return entry

    return changed


def scaled(message: Any) -> None:
    message.k[:8] *= 2.0
    message.p[:10] *= 2.0


def in_millimetres(message: Any) -> None:
    message.p[3] *= 1000.0


def alike(message: Any) -> None:
    message.p[3] = -207.0


@pytest.mark.parametrize(
    ('change', 'says'),
    [(in_millimetres, 'which no rig has'), (alike, 'the same P[3]')],
)
def test_a_bag_whose_calibration_cannot_be_gives_no_positions(
    demo_bag: Path, tmp_path: Path, change: Change, says: str
) -> None:
    done = process(rewritten(demo_bag, tmp_path / 'bag', in_bag(change)))
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count('\n') == 1


def test_a_calibration_of_other_pictures_gives_no_positions(
    demo_bag: Path, tmp_path: Path
) -> None:
    """K and P at twice the scale: positions would be off by metres, and look sure."""
    done = process(rewritten(demo_bag, tmp_path / 'bag', in_bag(scaled)))
    assert done.returncode == 1, done.stderr
    assert 'outside an image' in done.stdout
    assert used(done) == 0


def test_a_principal_point_far_off_the_middle_is_told(demo_bag: Path, tmp_path: Path) -> None:
    def shifted(message: Any) -> None:
        message.k[2] = 0.9 * message.width

    done = process(rewritten(demo_bag, tmp_path / 'bag', in_bag(shifted)))
    assert done.returncode == 0, done.stderr
    assert 'far off the middle' in done.stdout
    off = replace(LEFT, k=(FOCAL, 0.0, 0.9 * SIZE[0], *LEFT.k[3:]))
    assert WARNING in [each.level for each in diagnosed(tmp_path, off, right(0.23))]
