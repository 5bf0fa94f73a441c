"""What one camera alone looks through: simulated, and by the verb from rendered pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from binopos_ros.calibration.interface.calibrate import InterfaceCalibration, calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.report.verdicts import verdicts
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import FlatInterface, StereoRig
from binopos_ros.optics.rig_state import RigState

TILTS = (15.0, 55.0)
EVERYWHERE = (0.6, 0.5)


def alone(rig: StereoRig, side: int = 0) -> tuple[RigState, RigState]:
    """One camera of a rig with what it looks through, and the same in air."""
    whole = RigState.of(rig)
    own = ('interface', 'left_port' if side == 0 else 'right_port')
    interfaces = {place: one for place, one in whole.interfaces.items() if place in own}
    truth = RigState(whole.cameras[side : side + 1], interfaces=interfaces)
    return truth, replace(truth, interfaces={})


def square(truth: RigState, result: InterfaceCalibration) -> tuple[float, int]:
    """The normalised square of the errors of what pictures can tell, and its freedom."""
    error = -truth.minus(result.state)
    own = [
        i
        for i, name in enumerate(result.state.names)
        if name in result.prior and 'thick' not in name and 'indices' not in name
    ]
    block = result.covariance[np.ix_(own, own)]
    return float(error[own] @ np.linalg.solve(block, error[own])), len(own)


@pytest.mark.parametrize('kind', ['surface', 'wall', 'ports'])
def test_errors_are_those_stated(rig_maker: Any, board_viewer: Any, guesser: Any, kind: str):
    total, freedom = 0.0, 0
    for seed in range(4):
        rng = np.random.default_rng(40 + seed)
        rig, depths = rig_maker(kind, rng)
        side = seed % 2 if kind == 'ports' else 0
        truth, air = alone(rig, side)
        views = board_viewer(rig, depths, rng, 10, 0.1, TILTS, EVERYWHERE)
        views = [replace(view, pixels=view.pixels[side : side + 1]) for view in views]
        (guess,) = [one for one in guesser(rig) if one.place in truth.interfaces]
        result = calibrate_interface(air, views, [guess])
        assert result.dropped == ()
        assert result.adjustment is not None
        assert result.adjustment.sigma == pytest.approx(0.1, rel=0.1)
        found, count = square(truth, result)
        total, freedom = total + found, freedom + count
    assert chi2.ppf(0.005, freedom) < total < chi2.ppf(0.995, freedom)


def test_a_thick_slab_is_measured(dry_rig: Any, board_viewer: Any) -> None:
    """A tank full of water, air before and behind it: its thickness, where it is not known."""
    rng = np.random.default_rng(2)
    rig = dry_rig(FlatInterface([0.05, -0.04, 1.0], 0.3, (1.0, 1.333, 1.0), (0.256,)))
    _, air = alone(rig)
    views = [
        View(view.name, view.points, view.pixels[:1])
        for view in board_viewer(rig, (0.65, 0.9), rng, 10, 0.1, TILTS, EVERYWHERE)
    ]
    known = {'thicknesses.0': 0.05, 'indices.1': 0.0005}
    guess = InterfaceGuess('interface', (1.0, 1.333, 1.0), (0.23,), deviations=known)
    result = calibrate_interface(air, views, [guess])
    assert result.dropped == ()
    thickness = next(v for v in verdicts(result) if v.name == 'interface.thicknesses.0')
    assert abs(thickness.value - 0.256) < 4.0 * thickness.deviation
    assert thickness.deviation < 0.006
