"""Interfaces of simulated rigs, 17 of each kind, against their truth and the bound."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from binopos_ros.calibration.adjustment.positions import calibration_covariances
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.report.verdicts import (
    DETERMINED,
    IRRELEVANT,
    advice,
    verdicts,
)
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RigState
from binopos_ros.triangulation import triangulate

KINDS = ('surface', 'wall', 'ports')
RIGS = 51
TILTS = (15.0, 55.0)
EVERYWHERE = (0.6, 0.5)  # parts of the depth: as far aside as both pictures reach

of_all_rigs = pytest.mark.xdist_group('calibration of all rigs')


class Outcomes:
    """Errors and stated deviations over all rigs, by kind of parameter."""

    def __init__(self) -> None:
        self.errors: dict[str, list[float]] = {}
        self.deviations: dict[str, list[float]] = {}
        self.joint: list[bool] = []
        self.ratios: list[float] = []
        self.factors: list[float] = []

    def add(self, name: str, error: float, deviation: float) -> None:
        self.errors.setdefault(name, []).append(error)
        self.deviations.setdefault(name, []).append(deviation)

    def rms(self, name: str) -> float:
        return float(np.sqrt(np.mean(np.square(self.errors[name]))))


@pytest.fixture(scope='module')
def outcomes(rig_maker: Any, board_viewer: Any, guesser: Any) -> Outcomes:
    """51 rigs, 17 of each kind, calibrated from ten views mixed in tilt and place, 0.1 px."""
    found = Outcomes()
    for i in range(RIGS):
        rng = np.random.default_rng(5000 + i)
        rig, depths = rig_maker(KINDS[i % 3], rng)
        views = board_viewer(rig, depths, rng, tilts=TILTS, aside=EVERYWHERE)
        truth = RigState.of(rig)
        result = calibrate_interface(replace(truth, interfaces={}), views, guesser(rig))
        error = -truth.minus(result.state)
        names = result.state.names
        own = [
            names.index(name)
            for name in result.interface_names
            if 'thicknesses' not in name and 'indices' not in name
        ]
        for column in own:
            kind = next(k for k in ('index', 'normal', 'distance') if k in names[column])
            found.add(kind, error[column], result.deviation(names[column]))
        square = error[own] @ np.linalg.solve(result.covariance[np.ix_(own, own)], error[own])
        found.joint.append(bool(square < chi2.ppf(0.95, len(own))))
        assert result.adjustment is not None
        found.factors.append(result.adjustment.variance_factor)
        found.ratios.append(position_ratio(rig, depths, result.state, result.covariance, rng))
    return found


def position_ratio(
    rig: Any, depths: tuple[float, float], state: RigState, covariance: np.ndarray, rng: Any
) -> float:
    """Squared error of an independent target over the bound from pixels and calibration."""
    depth = rng.uniform(*depths, 200)
    centre = -rig.rotation.T @ rig.translation / 2.0
    aside = rng.uniform(-0.15, 0.15, (200, 2)) * depth[:, None]
    points = np.column_stack([centre[:2] + aside, depth])
    seen = [p + rng.normal(scale=0.1, size=p.shape) for p in rig.project(points)]
    pixel = 0.01 * np.eye(2)
    found = triangulate(state.rig(), *seen, pixel, pixel)
    good = found.reasons == ''
    known = ParameterCovariance(state.names, covariance)
    bound = found.covariances[good] + calibration_covariances(state, found.points[good], known)
    error = np.sum((found.points[good] - points[good]) ** 2, axis=1)
    return float(error.mean() / np.trace(bound, axis1=1, axis2=2).mean())


@of_all_rigs
@pytest.mark.parametrize(
    ('name', 'wanted'), [('index', 0.0025), ('normal', np.radians(0.1)), ('distance', 0.004)]
)
def test_errors_over_all_rigs(outcomes: Outcomes, name: str, wanted: float) -> None:
    assert outcomes.rms(name) < wanted


@of_all_rigs
@pytest.mark.parametrize('name', ['index', 'normal', 'distance'])
def test_stated_deviations_are_those_of_the_errors(outcomes: Outcomes, name: str) -> None:
    ratio = np.array(outcomes.errors[name]) / outcomes.deviations[name]
    assert np.std(ratio) == pytest.approx(1.0, abs=0.2)
    assert 0.90 < np.mean(np.abs(ratio) < 1.96) < 0.99


@of_all_rigs
def test_truth_lies_in_the_stated_region_in_95_of_100_runs(outcomes: Outcomes) -> None:
    assert 0.93 <= np.mean(outcomes.joint) <= 0.97


@of_all_rigs
def test_independent_points_are_taken_for_such(outcomes: Outcomes) -> None:
    assert np.mean(np.array(outcomes.factors) > 1.0) < 0.05


@of_all_rigs
def test_independent_positions_reach_the_bound(outcomes: Outcomes) -> None:
    assert np.sqrt(np.mean(outcomes.ratios)) < 1.1


def test_ports_and_a_wall_behind_them_are_calibrated_together(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    square, ratios = 0.0, []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        rig, depths = rig_maker('housing', rng)
        air = replace(RigState.of(rig), interfaces={})
        views = board_viewer(rig, depths, rng, tilts=TILTS)
        result = calibrate_interface(air, views, guesser(rig))
        error = -RigState.of(rig).minus(result.state)
        own = [i for i, name in enumerate(result.state.names) if name in result.prior]
        wall = [i for i in own if result.state.names[i].startswith(('target', 'interface'))]
        wall = [i for i in wall if 'indices' not in result.state.names[i]]
        block = result.covariance[np.ix_(wall, wall)]
        square += error[wall] @ np.linalg.solve(block, error[wall])
        ratios.append(position_ratio(rig, depths, result.state, result.covariance, rng))
    assert square < chi2.ppf(0.99, 2 * len(wall))
    assert np.sqrt(np.mean(ratios)) < 1.3
    by_name = {verdict.name: verdict for verdict in verdicts(result)}
    assert by_name['target_index'].grade == DETERMINED
    assert by_name['interface.distance'].grade == DETERMINED
    assert by_name['left_port.distance'].grade == IRRELEVANT
    assert 'only shifts the rays' in by_name['left_port.distance'].text
    assert 'port' not in advice(result)


def test_same_optimum_as_scipy(rig_maker: Any, board_viewer: Any, guesser: Any) -> None:
    rng = np.random.default_rng(9)
    rig, depths = rig_maker('surface', rng)
    views = board_viewer(rig, depths, rng, count=4)
    air = replace(RigState.of(rig), interfaces={})
    (guess,) = guesser(rig)
    result = calibrate_interface(air, views, [guess], robust=False, sigma=0.1)
    fit = result.adjustment
    assert fit is not None
    first = len(result.state.names) - 4

    def residuals(x: np.ndarray) -> np.ndarray:
        state = result.state.plus(np.concatenate([np.zeros(first), x[:4]]))
        moved = state.rig()
        parts = []
        for i, (view, pose) in enumerate(zip(views, fit.poses, strict=True)):
            shift = x[4 + 6 * i : 10 + 6 * i]
            turned = Pose(_rotation(shift[:3]) @ pose.rotation, pose.translation + shift[3:])
            seen = moved.project(turned.apply(view.points))
            parts += [((a - b) / 0.1).ravel() for a, b in zip(view.pixels, seen, strict=True)]
        normal = state.interfaces['interface'].normal
        parts.append(np.array([(state.target_index - 1.333) / 0.1, *(normal[:2] / 0.5)]))
        return np.concatenate(parts)

    better = least_squares(residuals, np.zeros(4 + 24), x_scale='jac', xtol=1e-14, ftol=1e-14)
    assert 2.0 * better.cost == pytest.approx(np.sum(residuals(np.zeros(28)) ** 2), rel=1e-5)
    spread = np.sqrt(np.diag(np.linalg.inv(better.jac.T @ better.jac)))[:4]
    assert np.abs(better.x[:4] / spread).max() < 0.02
    own = np.sqrt(np.diag(result.covariance))[first:]
    np.testing.assert_allclose(own, spread, rtol=0.01)


def _rotation(vector: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()
