"""Interfaces: what is refused and left out, and what is said then."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.optics import FlatInterface, StereoRig
from binopos_ros.optics.rig_state import RigState

TILTS = (15.0, 55.0)
EVERYWHERE = (0.6, 0.5)  # parts of the depth: as far aside as both pictures reach


def test_outlying_points_are_left_out(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(8)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng)
    for view in views[:3]:
        view.pixels[0][5:8] += [6.0, -4.0]
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, guesser(rig))
    assert result.adjustment is not None
    assert not result.adjustment.inliers[0][0][5:8].any()
    assert result.adjustment.inliers[5][0].all()
    error = -RigState.of(rig).minus(result.state)
    assert abs(error[-1]) < 3.5 * result.deviation('interface.distance')


def test_a_bad_view_is_left_out_with_the_reason(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(8)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng)
    views[4] = replace(views[4], pixels=(views[4].pixels[0], views[4].pixels[1] + [9.0, 14.0]))
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, guesser(rig))
    assert [one.name for one in result.dropped] == ['view 4']
    assert 'moved' in result.dropped[0].reason
    square = np.sum((result.state.interfaces['interface'].normal - rig.interface.normal) ** 2)
    assert np.sqrt(square) < np.radians(0.4)


def test_pictures_of_something_else_are_refused(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(8)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=5)
    air = replace(RigState.of(rig), interfaces={})
    wrong = {
        'left and right are swapped': [replace(v, pixels=v.pixels[::-1]) for v in views],
        "check the board's size": [replace(v, points=1.1 * v.points) for v in views],
        'do not belong together': [
            replace(v, pixels=(v.pixels[0], views[(i + 2) % 5].pixels[1]))
            for i, v in enumerate(views)
        ],
    }
    for line, seen in wrong.items():
        with pytest.raises(CalibrationError, match=line):
            calibrate_interface(air, seen, guesser(rig))


@pytest.mark.parametrize(
    ('change', 'scale', 'line'),
    [
        ({'distance': 800.0, 'deviations': {'distance': 5.0}}, 1.0, 'with distance 0.8 m'),
        ({'thicknesses': (12.0,)}, 1.0, 'with thickness 0.012 m'),
        ({'deviations': {'target_index': 0.0005}}, 1.2, 'a board about 0.83 times as large'),
    ],
)
def test_what_would_explain_the_pictures_is_named(
    board_viewer: Any, dry_rig: Any, change: dict[str, Any], scale: float, line: str
) -> None:
    rng = np.random.default_rng(3)
    rig = dry_rig(FlatInterface([0.05, -0.04, 1.0], 0.8, (1.0, 1.49, 1.333), (0.012,)))
    views = board_viewer(rig, (1.0, 1.3), rng, 6, 0.1, TILTS, EVERYWHERE)
    views = [replace(view, points=scale * view.points) for view in views]
    guess = replace(InterfaceGuess('interface', (1.0, 1.49, 1.333), (0.012,)), **change)
    with pytest.raises(CalibrationError, match=line):
        calibrate_interface(replace(RigState.of(rig), interfaces={}), views, [guess])


@pytest.mark.parametrize('deviations', [{}, {'target_index': 0.0005}])
def test_pictures_taken_in_air_are_told(
    board_viewer: Any, dry_rig: Any, deviations: dict[str, float]
) -> None:
    rng = np.random.default_rng(3)
    wet = dry_rig(FlatInterface([0.0, 0.0, 1.0], 0.5, (1.0, 1.333)))
    dry = StereoRig(wet.left, wet.right, wet.rotation, wet.translation)
    views = board_viewer(dry, (0.7, 1.0), rng, 6, 0.1, TILTS, EVERYWHERE)
    guess = InterfaceGuess('interface', (1.0, 1.333), deviations=deviations)
    with pytest.raises(CalibrationError, match=r'taken in air|that of air and of no liquid'):
        calibrate_interface(replace(RigState.of(wet), interfaces={}), views, [guess])


def test_views_that_repeat_each_other_count_once(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    rng = np.random.default_rng(5)
    rig, depths = rig_maker('surface', rng)
    air = replace(RigState.of(rig), interfaces={})
    views = board_viewer(rig, depths, rng, tilts=TILTS)
    again = [
        replace(view, pixels=tuple(p + rng.normal(scale=0.1, size=p.shape) for p in view.pixels))
        for view in views
    ]
    once = calibrate_interface(air, views, guesser(rig))
    twice = calibrate_interface(air, [*views, *again], guesser(rig))
    assert sum('repeats' in one.reason for one in twice.dropped) == len(views)
    assert twice.deviation('target_index') == pytest.approx(once.deviation('target_index'))


@pytest.mark.parametrize(
    ('guesses', 'line'),
    [
        ([InterfaceGuess('interface', (1.0, 1.333))], 'must be measured by hand'),
        ([], 'one shared surface, or a port for each camera'),
        (
            [
                InterfaceGuess('left_port', (1.0, 1.5, 1.33), (0.01,), 0.1),
                InterfaceGuess('right_port', (1.0, 1.5, 1.34), (0.01,), 0.1),
            ],
            'different media',
        ),
        (
            [
                InterfaceGuess('interface', (1.0, 1.333), (), 0.8),
                InterfaceGuess('left_port', (1.0, 1.5, 1.33), (0.01,), 0.1),
                InterfaceGuess('right_port', (1.0, 1.5, 1.33), (0.01,), 0.1),
            ],
            'it is the same medium',
        ),
    ],
)
def test_unknown_interfaces_are_refused(
    rig_maker: Any, guesses: list[InterfaceGuess], line: str
) -> None:
    rig, _ = rig_maker('surface', np.random.default_rng(1))
    with pytest.raises(CalibrationError, match=line):
        calibrate_interface(replace(RigState.of(rig), interfaces={}), [], guesses)
