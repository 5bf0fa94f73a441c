"""Interfaces: what is determined, by pictures and by rulers, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from binopos_ros.calibration.adjustment.adjust import view_information
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.report.summary import summarise_interface
from binopos_ros.calibration.report.verdicts import (
    DETERMINED,
    PRIOR,
    WEAK,
    advice,
    verdicts,
)
from binopos_ros.calibration.views.balls import ball_view
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.targets import Blob
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RigState

TILTS = (15.0, 55.0)


def test_flat_boards_leave_the_index_open_and_say_so(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(4)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=4, tilts=(0.0, 1.0))
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, guesser(rig))
    index = verdicts(result)[0]
    assert index.name == 'target_index'
    assert index.grade in (WEAK, PRIOR)
    assert 'tilt the board by 30-45 degrees' in index.text
    assert 'tilt the board' in advice(result)
    assert abs(result.state.target_index - rig.target_index) < 3.0 * index.deviation


def test_a_ball_hardly_shows_the_index_and_the_verdict_says_so(rig_maker: Any) -> None:
    rng = np.random.default_rng(4)
    rig, depths = rig_maker('surface', rng)
    air = replace(RigState.of(rig), interfaces={})
    centre = -rig.rotation.T @ rig.translation / 2.0
    free = np.array([name.startswith(('target', 'interface')) for name in RigState.of(rig).names])
    information = np.diag([0.1**-2, 0.5**-2, 0.5**-2, 0.0])
    views = []
    for i in range(20):
        depth = rng.uniform(*depths)
        place = np.array([*(centre[:2] + rng.uniform(-0.3, 0.3, 2) * depth), depth])
        edges = rig.project(place + np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]))
        blobs = tuple(
            Blob(
                pair.mean(axis=0) + rng.normal(scale=0.1, size=2),
                0.01 * np.eye(2),
                float(np.linalg.norm(pair[1] - pair[0]) + 0.14 * rng.normal()),
            )
            for pair in edges
        )
        views.append(ball_view(f'{i}', air, blobs, 0.04))
        pose = Pose(np.eye(3), place)
        information += view_information(RigState.of(rig), pose, views[-1], free, 0.1 / 0.5**0.5)
    guess = InterfaceGuess('interface', (1.0, 1.333))
    result = calibrate_interface(air, views, [guess], sigma=0.1 / 0.5**0.5)
    by_name = {verdict.name: verdict for verdict in verdicts(result)}
    index = by_name['target_index']
    bound = float(np.sqrt(np.linalg.inv(information)[0, 0]))
    assert bound > 0.01  # a board in ten mixed tilts gives 0.0015
    assert abs(index.value - rig.target_index) < 3.0 * index.deviation
    assert index.grade in (WEAK, PRIOR)
    assert 'hardly shows it' in index.text
    assert '--prior target_index' in index.text
    ruler = replace(guess, deviations={'target_index': 0.0005})
    known = verdicts(calibrate_interface(air, views, [ruler], sigma=0.1 / 0.5**0.5))[0]
    assert known.grade == DETERMINED
    assert 'by what you measured' in known.text


def test_mixed_boards_are_determined(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(5)
    rig, depths = rig_maker('wall', rng)
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, board_viewer(rig, depths, rng, tilts=TILTS), guesser(rig))
    own = [v for v in verdicts(result) if 'layer' not in v.text]
    assert {v.grade for v in own} == {DETERMINED}
    assert advice(result).startswith('Nothing must be done')


def test_a_bowed_board_is_told_and_taken_into_account(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(1)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, 10, 0.1, TILTS, (0.6, 0.5), bow=0.0005)
    truth = RigState.of(rig)
    result = calibrate_interface(replace(truth, interfaces={}), views, guesser(rig))
    np.testing.assert_allclose(
        result.shape.warp, [0.0005, 0.0, 0.0], atol=4.0 * result.shape.deviations.max()
    )
    assert result.shape.deviations.max() < 2e-5
    assert 'bowed by +0.5' in summarise_interface(result)
    error = -truth.minus(result.state)
    own = [i for i, name in enumerate(result.state.names) if name in result.prior]
    square = error[own] @ np.linalg.solve(result.covariance[np.ix_(own, own)], error[own])
    assert square < chi2.ppf(0.99, len(own))


def test_a_ruler_narrows_the_distance(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(6)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=3)
    air = replace(RigState.of(rig), interfaces={})
    (guess,) = guesser(rig)
    free = calibrate_interface(air, views, [guess])
    ruler = replace(guess, distance=rig.interface.distance, deviations={'distance': 0.001})
    held = calibrate_interface(air, views, [ruler])
    assert held.deviation('interface.distance') < 0.001
    assert held.deviation('interface.distance') < 0.5 * free.deviation('interface.distance')
    assert held.deviation('target_index') < free.deviation('target_index')


def test_uncertain_cameras_widen_the_deviations(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(7)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng)
    air = replace(RigState.of(rig), interfaces={})
    known = ParameterCovariance(('left.fx', 'right.fx', 'translation.x'), np.diag([4, 4, 1e-6]))
    exact = calibrate_interface(air, views, guesser(rig))
    loose = calibrate_interface(air, views, guesser(rig), known)
    assert loose.deviation('target_index') > exact.deviation('target_index')
    assert 0 < loose.deviation('left.fx') <= 2.0


def test_ruler_alone_is_enough(rig_maker: Any) -> None:
    rig, _ = rig_maker('surface', np.random.default_rng(1))
    air = replace(RigState.of(rig), interfaces={})
    guess = InterfaceGuess(
        'interface', (1.0, 1.333), distance=0.8, deviations={'distance': 0.003, 'normal': 0.01}
    )
    result = calibrate_interface(air, [], [guess])
    assert result.state.interfaces['interface'].distance == 0.8
    assert result.deviation('interface.distance') == pytest.approx(0.003)
    assert any('what you measured' in verdict.text for verdict in verdicts(result))
