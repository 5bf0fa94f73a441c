"""The covariance on disk and on its way to positions, against finite differences and sampling."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.calibration.adjustment.positions import (
    calibration_covariances,
    position_jacobians,
)
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.optics import OpticsError
from binopos_ros.optics.covariance_file import (
    ParameterCovariance,
    read_covariance,
    write_covariance,
)
from binopos_ros.optics.rig_state import Camera, RigState
from binopos_ros.triangulation import triangulate


@pytest.fixture(params=['surface', 'wall', 'ports'])
def rig(request: pytest.FixtureRequest, rig_maker: Any) -> Any:
    return rig_maker(request.param, np.random.default_rng(3))


def some_points(depths: tuple[float, float], count: int = 12) -> np.ndarray:
    rng = np.random.default_rng(4)
    return rng.uniform([-0.05, -0.1, depths[0]], [0.2, 0.1, depths[1]], (count, 3))


def test_positions_follow_the_parameters_as_triangulation_does(rig: Any) -> None:
    rig, depths = rig
    state = RigState.of(rig)
    points = some_points(depths)
    pixels = rig.project(points)
    _, by_parameters = position_jacobians(state, points)
    for column, name in enumerate(state.names):
        step = np.zeros(len(state.names))
        step[column] = 1e-3 if 'fx' in name or 'cx' in name else 1e-6
        ahead, behind = (triangulate(state.plus(s).rig(), *pixels).points for s in (step, -step))
        expected = (ahead - behind) / (2.0 * step[column])
        scale = np.abs(expected).max() + 1e-6
        assert np.abs(by_parameters[:, :, column] - expected).max() < 2e-3 * scale, name


def test_surface_part_is_what_the_triangulator_adds(
    rig: Any, board_viewer: Any, guesser: Any
) -> None:
    rig, depths = rig
    rng = np.random.default_rng(5)
    air = replace(RigState.of(rig), interfaces={})
    views = board_viewer(rig, depths, rng)
    result = calibrate_interface(air, views, guesser(rig))
    known = ParameterCovariance(result.state.names, result.covariance)
    calibrated = result.state.rig()
    pixels = calibrated.project(some_points(depths))
    surfaces = known.ordered(calibrated.parameter_names)
    plain = triangulate(calibrated, *pixels)
    added = triangulate(calibrated, *pixels, parameter_covariance=surfaces)
    np.testing.assert_allclose(
        added.covariances - plain.covariances,
        calibration_covariances(result.state, plain.points, known),
        rtol=1e-4,
        atol=1e-14,
    )


def test_sampled_calibrations_scatter_as_propagated(rig_maker: Any) -> None:
    rng = np.random.default_rng(6)
    rig, depths = rig_maker('surface', rng)
    state = RigState.of(rig)
    spread = np.full(len(state.names), 1e-6)
    for name, value in {
        'left.fx': 0.5,
        'right.cx': 0.3,
        'rotation.y': 2e-4,
        'translation.x': 1e-4,
        'target_index': 1e-3,
        'interface.normal.0': 1e-3,
        'interface.distance': 2e-3,
    }.items():
        spread[state.names.index(name)] = value
    points = some_points(depths, 4)
    pixels = rig.project(points)
    cloud = np.array(
        [
            triangulate(state.plus(rng.normal(size=len(spread)) * spread).rig(), *pixels).points
            for _ in range(400)
        ]
    )
    known = ParameterCovariance(state.names, np.diag(spread**2))
    expected = calibration_covariances(state, points, known)
    sampled = np.array([np.cov(cloud[:, i].T) for i in range(4)])
    ratio = np.trace(sampled, axis1=1, axis2=2) / np.trace(expected, axis1=1, axis2=2)
    np.testing.assert_allclose(ratio, 1.0, atol=0.2)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), scale=st.floats(1e-12, 1e6))
def test_round_trip_is_exact(
    tmp_path_factory: pytest.TempPathFactory, seed: int, scale: float
) -> None:
    rng = np.random.default_rng(seed)
    camera = Camera(np.array([800.0, 800.0]), np.array([320.0, 240.0]), np.zeros(5), (640, 480))
    state = RigState((camera, camera), translation=np.array([-0.1, 0.0, 0.0]))
    root = rng.normal(size=(len(state.names),) * 2) * scale
    path = tmp_path_factory.mktemp('covariance') / 'covariance.yaml'
    write_covariance(path, state, root @ root.T)
    found = read_covariance(path)
    assert found.names == state.names
    np.testing.assert_array_equal(found.matrix, root @ root.T)


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('names: [a]\ncovariance: [[1.0, 2.0]]', 'finite 1x1 covariance'),
        ('names: [a]\ncovariance: [[.nan]]', 'finite 1x1 covariance'),
        ('names: [a, b]\ncovariance: [[1.0, 2.0], [0.0, 1.0]]', 'not symmetric'),
        ('names: [a]\ncovariance: [[-1.0]]', 'not symmetric'),
        ('hello', 'no names and covariance'),
        ('names: [a', 'not valid YAML'),
        ('names: 3\ncovariance: 4', 'no names and covariance'),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, text: str, line: str) -> None:
    path = tmp_path / 'covariance.yaml'
    path.write_text(text)
    with pytest.raises(OpticsError, match=line):
        read_covariance(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(OpticsError, match=r'none\.yaml'):
        read_covariance(tmp_path / 'none.yaml')
