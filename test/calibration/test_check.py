"""The check of every day: turned cameras are found and measured, waves and noise are not."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.check import daily
from binopos_ros.calibration.check.daily import DailyCheck
from binopos_ros.calibration.check.doubled import Refraction, refraction
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.targets import Blob, TargetPair
from binopos_ros.optics import PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import exponential
from binopos_ros.triangulation import triangulate

PIXEL = 0.01 * np.eye(2)


def operation(
    rig: StereoRig,
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0),
    count: int = 400,
    wave: float = 0.0,
) -> list[TargetPair]:
    """A target on its way as the rig sees it whose right camera has turned by `turn` (rad)."""
    rng = np.random.default_rng(3)
    turned = exponential(np.array(turn))
    actual = StereoRig(
        rig.left, rig.right, turned @ rig.rotation, turned @ rig.translation, rig.interface
    )
    t = np.linspace(0.0, 20.0, count)
    depth = rig.interface.distance + 0.2 + 0.05 * np.sin(2.0 * t)
    points = np.column_stack([0.115 + 0.15 * np.sin(t), 0.1 * np.cos(0.7 * t), depth])
    shaken = wave * np.sin(25.0 * t + 1.0)
    pairs = []
    for i, (left, right) in enumerate(zip(*actual.project(points), strict=True)):
        noise = rng.normal(scale=0.1, size=(2, 2))
        noise[1, 1] += shaken[i]
        pairs.append(
            TargetPair(i, Blob(left + noise[0], PIXEL, 30.0), Blob(right + noise[1], PIXEL, 30.0))
        )
    return pairs


@pytest.fixture(scope='module')
def rig(rig_maker: Any) -> StereoRig:
    return rig_maker('surface', np.random.default_rng(3))[0]


def check(rig: StereoRig, targets: list[TargetPair]) -> DailyCheck:
    found = triangulate(
        rig,
        np.array([pair.left.centre for pair in targets]),
        np.array([pair.right.centre for pair in targets]),
    )
    return daily.check(rig, found.points, found.residuals)


def verdict(rig: StereoRig, *turn: float, **options: Any) -> DailyCheck:
    return check(rig, operation(rig, (turn[0], turn[1], turn[2]), **options))


def test_an_unmoved_rig_holds(rig: StereoRig) -> None:
    result = verdict(rig, 0.0, 0.0, 0.0)
    assert result.holds
    assert abs(result.mean) < 3.5 * result.deviation
    assert result.scatter == pytest.approx(0.1, rel=0.1)
    assert 0.05e-3 < result.skew < 0.25e-3


@pytest.mark.parametrize('pitch', [0.0005, -0.002])
def test_pitch_is_found_and_measured(rig: StereoRig, pitch: float) -> None:
    result = verdict(rig, pitch, 0.0, 0.0)
    assert not result.holds
    assert result.pitch[0] == pytest.approx(pitch, abs=4.0 * result.pitch[1])
    assert 'no longer holds' in result.text
    assert 'binopos calibrate stereo' in result.text


def test_roll_is_found_and_measured(rig: StereoRig) -> None:
    result = verdict(rig, 0.0, 0.0, 0.006)
    assert not result.holds
    assert result.roll[0] == pytest.approx(0.006, rel=0.2)


def test_waves_widen_the_scatter_but_raise_no_alarm(rig: StereoRig) -> None:
    result = verdict(rig, 0.0, 0.0, 0.0, wave=1.0)
    assert result.holds
    assert result.scatter > 0.4


@pytest.mark.parametrize(('kind', 'seed'), [('ports', 1), ('surface', 2), ('wall', 3)])
def test_cameras_calibrated_in_water_and_an_interface_on_top_are_found(
    rig_maker: Any, board_viewer: Any, kind: str, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    truth, depths = rig_maker(kind, rng)
    views = board_viewer(truth, depths, rng, 8, 0.05, (15.0, 45.0), (0.6, 0.5))
    boards = [view.points.astype(np.float32) for view in views]
    sides = [[view.pixels[side].astype(np.float32) for view in views] for side in (0, 1)]
    size = tuple(truth.left.size)
    one = [cv2.calibrateCamera(boards, side, size, np.eye(3), np.zeros(5)) for side in sides]
    guess = cv2.CALIB_USE_INTRINSIC_GUESS
    wet = cv2.stereoCalibrate(boards, *sides, *one[0][1:3], *one[1][1:3], size, flags=guess)
    assert wet[1][0, 0] > 1.3 * truth.left.matrix[0, 0]
    cameras = [PinholeCamera(wet[i], wet[i + 1].ravel(), size) for i in (1, 3)]
    pose = wet[5], wet[6].ravel()
    media = {
        'interface': truth.interface,
        'left_port': truth.left_port,
        'right_port': truth.right_port,
    }
    wet_rig, wet_air = StereoRig(*cameras, *pose, **media), StereoRig(*cameras, *pose)
    bare = StereoRig(truth.left, truth.right, truth.rotation, truth.translation)

    def seen(reach: float) -> list[np.ndarray]:
        depth = rng.uniform(*depths, 200)
        aside = rng.uniform([-reach, -0.8 * reach], [reach, 0.8 * reach], (200, 2))
        middle = -(truth.rotation.T @ truth.translation)[:2] / 2.0
        points = np.column_stack([middle + aside * depth[:, None], depth])
        return [p + rng.normal(scale=0.1, size=p.shape) for p in truth.project(points)]

    def found(rig: StereoRig, air: StereoRig, pixels: list[np.ndarray]) -> Refraction:
        bent, straight = triangulate(rig, *pixels), triangulate(air, *pixels)
        return refraction(rig, bent.points, bent.residuals, straight.points, straight.residuals)

    pixels = seen(0.3)
    twice = found(wet_rig, wet_air, pixels)
    assert twice.is_twice
    assert 'counted twice' in twice.text
    once = found(truth, bare, pixels)
    assert not once.is_twice
    assert once.text == ''
    assert abs(once.surplus) < 4.0 * once.deviation
    # A ruler's error of a fifth, and a normal 2 degrees off, are other faults.
    for change in ({'distance': 0.2}, {'normal.0': 0.035}):
        wrong = {
            place: one.changed({name: d * (one.distance if name == 'distance' else 1.0)})
            for place, one in media.items()
            if one is not None
            for name, d in change.items()
        }
        rig = StereoRig(bare.left, bare.right, bare.rotation, bare.translation, **wrong)
        assert not found(rig, bare, pixels).is_twice
    # In the very middle nothing shows it, and that is said.
    if kind == 'surface':
        assert 'do not show' in found(truth, bare, seen(0.01)).text


def test_few_pairs_are_refused(rig: StereoRig) -> None:
    with pytest.raises(CalibrationError, match='record a longer piece'):
        check(rig, operation(rig)[:10])


def test_pictures_of_different_things_do_not_count(rig: StereoRig) -> None:
    pairs = operation(rig)
    foreign = [
        TargetPair(p.stamp, p.left, Blob(p.right.centre + np.array([0, 40]), PIXEL, 30.0))
        for p in pairs
    ]
    assert check(rig, pairs + foreign[:100]).pairs == len(pairs)
    with pytest.raises(CalibrationError):
        check(rig, foreign)
