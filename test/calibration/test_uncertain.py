"""The whole calibration's covariance on its way to the live position."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from binopos_ros.calibration.adjustment.positions import calibration_covariances
from binopos_ros.calibration.report.files import camera_infos
from binopos_ros.optics import StereoRig
from binopos_ros.optics.covariance_file import ParameterCovariance, write_covariance
from binopos_ros.optics.rig_state import RigState
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.parameters import build
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Position, Triangulator

#: Standard deviations of a plausible calibration, by the last word of a parameter's name.
SPREADS = {
    'fx': 0.4,
    'fy': 0.4,
    'cx': 0.6,
    'cy': 0.6,
    'k1': 1e-3,
    'k2': 1e-3,
    'k3': 1e-3,
    'p1': 1e-4,
    'p2': 1e-4,
    'target_index': 1e-3,
    'distance': 2e-3,
}


@pytest.fixture(params=['surface', 'wall', 'ports'])
def rig(request: pytest.FixtureRequest, rig_maker: Any) -> Any:
    return rig_maker(request.param, np.random.default_rng(3))


def uncertain(rig: StereoRig) -> UncertainRig:
    return UncertainRig(
        rig.left,
        rig.right,
        rig.rotation,
        rig.translation,
        rig.interface,
        rig.left_port,
        rig.right_port,
    )


def some_points(depths: tuple[float, float], count: int = 12) -> np.ndarray:
    rng = np.random.default_rng(4)
    return rng.uniform([-0.05, -0.1, depths[0]], [0.2, 0.1, depths[1]], (count, 3))


def correlated(names: tuple[str, ...], rng: np.random.Generator) -> np.ndarray:
    """A covariance with the `SPREADS` (others 3e-4), every pair of parameters correlated."""
    spread = np.array([SPREADS.get(name.split('.')[-1], 3e-4) for name in names])
    root = np.eye(len(names)) + 0.2 * rng.normal(size=(len(names),) * 2)
    square = root @ root.T
    scale = spread / np.sqrt(np.diag(square))
    return square * np.outer(scale, scale)


def test_derivatives_are_those_of_the_changed_rigs(rig: Any) -> None:
    rig, depths = rig
    whole, points = uncertain(rig), some_points(depths)
    assert whole.parameter_names[: len(rig.parameter_names)] == rig.parameter_names
    assert {'left.fx', 'right.k3', 'rotation.y', 'translation.x'} <= set(whole.parameter_names)
    found = whole.parameter_jacobian(points)
    for column, name in enumerate(whole.parameter_names):
        if name.endswith('indices.0'):
            continue  # of the cameras' own medium, which is exact
        step = np.zeros(len(whole.parameter_names))
        step[column] = 1e-3 if name.split('.')[-1] in ('fx', 'fy', 'cx', 'cy') else 1e-6
        pairs = zip(
            whole.perturbed(step).project(points),
            whole.perturbed(-step).project(points),
            strict=True,
        )
        for jacobian, (ahead, behind) in zip(found, pairs, strict=True):
            expected = (ahead - behind) / (2.0 * step[column])
            scale = 1.0 + np.abs(expected).max()
            assert np.abs(jacobian[:, :, column] - expected).max() < 1e-5 * scale, name


def test_triangulation_adds_the_cameras_part(rig: Any) -> None:
    rig, depths = rig
    whole = uncertain(rig)
    state = RigState.of(rig)
    known = ParameterCovariance(state.names, correlated(state.names, np.random.default_rng(1)))
    covariance = known.ordered(whole.parameter_names)
    pixels = rig.project(some_points(depths))
    plain = triangulate(rig, *pixels)
    added = triangulate(whole, *pixels, parameter_covariance=covariance)
    expected = calibration_covariances(state, plain.points, known)
    np.testing.assert_allclose(
        added.covariances - plain.covariances, expected, atol=1e-6 * np.abs(expected).max()
    )
    np.testing.assert_array_equal(added.points, plain.points)


def stage_of(state: RigState, **values: Any) -> Triangulator:
    """The triangulator's stage as `run` and `process` set it up from the calibration's files."""
    interface = state.interfaces['interface']
    options = {
        'interface.normal': [float(x) for x in interface.normal],
        'interface.distance': interface.distance,
        'interface.indices': [float(x) for x in interface.indices],
        'interface.normal_std': 0.0,
        'interface.distance_std': 0.0,
        'baseline_std': 0.0,
    }
    stage = Triangulator(build(TriangulatorOptions, options | values))
    for side, info in zip(('left', 'right'), camera_infos(state), strict=True):
        stage.set_camera(side, info)
    return stage


def position(stage: Triangulator, pixels: tuple[np.ndarray, np.ndarray], sigma: float) -> Position:
    found = [
        event
        for side, pixel in zip(('left', 'right'), pixels, strict=True)
        for event in stage.add(side, Centroid(0, side, pixel, sigma**2 * np.eye(2), 20.0))
    ]
    assert isinstance(found[0], Position), found
    return found[0]


@pytest.mark.parametrize(('follows_the_index', 'draws'), [(False, 120), (True, 40)])
def test_positions_scatter_as_the_stage_says(
    rig_maker: Any, tmp_path: Path, follows_the_index: bool, draws: int
) -> None:
    """Each draw is a calibration with its own error, read from files, and one noisy pair."""
    rng = np.random.default_rng(5)
    truth = RigState.of(rig_maker('surface', rng)[0])
    covariance = correlated(truth.names, rng)
    options: dict[str, Any] = {'calibration_covariance': str(tmp_path / 'covariance.yaml')}
    index = truth.names.index('target_index')
    if follows_the_index:
        # The estimate has a prior of its own, which the calibration's errors know nothing of.
        covariance[index, :] = covariance[:, index] = 0.0
        covariance[index, index] = 1e-6
        options |= {'index.std': 1e-3, 'index.calibration_std': 0.0}
    write_covariance(tmp_path / 'covariance.yaml', truth, covariance)
    root = np.linalg.cholesky(covariance)
    point = np.array([0.12, 0.05, truth.interfaces['interface'].distance + 0.3])
    pixels = truth.rig().project(point)
    sigma = 0.1
    squares, exact = [], []
    for _ in range(draws):
        drawn = truth.plus(root @ rng.normal(size=len(root)))
        noisy = (pixels[0] + sigma * rng.normal(size=2), pixels[1] + sigma * rng.normal(size=2))
        found = position(stage_of(drawn, **options), noisy, sigma)
        error = found.point - point
        squares.append(error @ np.linalg.solve(found.covariance, error))
        known = position(stage_of(drawn), noisy, sigma).covariance
        exact.append(error @ np.linalg.solve(known, error))
    # The mean of so many chi-squared of three degrees of freedom scatters by sqrt(6 / draws).
    assert np.mean(squares) == pytest.approx(3.0, abs=3.0 * np.sqrt(6.0 / draws))
    assert np.mean(exact) > 6.0  # the calibration matters here
