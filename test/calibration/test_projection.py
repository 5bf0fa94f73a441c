"""Pixels and derivatives against the optics room's own projection, and finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import RigState, exponential

STEP = 1e-6
MATRIX = [[800.0, 0.0, 640.0], [0.0, 810.0, 480.0], [0.0, 0.0, 1.0]]
SKEWED = [[800.0, 7.0, 640.0], *MATRIX[1:]]
SURFACES = {
    'air': {},
    'surface': {'interface': FlatInterface([0.05, -0.03, 1.0], 0.8, (1.0, 1.333))},
    'wall': {'interface': FlatInterface([0.05, -0.03, 1.0], 0.8, (1.0, 1.5, 1.333), (0.01,))},
    'ports': {
        'left_port': FlatInterface([0.05, -0.03, 1.0], 0.05, (1.0, 1.5, 1.333), (0.01,)),
        'right_port': FlatInterface([-0.05, 0.03, 1.0], 0.06, (1.0, 1.47, 1.333), (0.008,)),
    },
    'ports before a wall': {
        'interface': FlatInterface([0.05, -0.03, 1.0], 0.8, (1.0, 1.5, 1.333), (0.01,)),
        'left_port': FlatInterface([0.05, -0.03, 1.0], 0.05, (1.0, 1.5, 1.0), (0.01,)),
        'right_port': FlatInterface([-0.05, 0.03, 1.0], 0.06, (1.0, 1.47, 1.0), (0.008,)),
    },
}


@pytest.fixture(params=SURFACES)
def rig(request: pytest.FixtureRequest) -> StereoRig:
    left = PinholeCamera(MATRIX, [-0.1, 0.05, 0.001, -0.002, 0.01], (1280, 960))
    terms = [-0.1, 0.05, 0.001, -0.002, 0.01, 0.1, 0.02, 0.03]
    right = PinholeCamera(SKEWED, terms, (1280, 960))
    rotation = exponential(np.array([0.02, -0.1, 0.03]))
    return StereoRig(left, right, rotation, [-0.23, 0.01, 0.02], **SURFACES[request.param])


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(0).uniform([-0.3, -0.2, 1.0], [0.4, 0.2, 1.5], (20, 3))


@pytest.mark.parametrize('side', [0, 1])
def test_projects_as_the_optics_room_does(rig: StereoRig, points: np.ndarray, side: int) -> None:
    seen = project(RigState.of(rig), side, points).pixels
    np.testing.assert_allclose(seen, rig.project(points)[side], atol=1e-10)


@pytest.mark.parametrize('side', [0, 1])
def test_derivatives_are_those_of_finite_differences(
    rig: StereoRig, points: np.ndarray, side: int
) -> None:
    state = RigState.of(rig)
    seen = project(state, side, points)
    for column in range(len(state.names)):
        step = np.zeros(len(state.names))
        step[column] = STEP
        ahead, behind = (
            np.asarray(state.plus(s).rig().project(points)[side]) for s in (step, -step)
        )
        expected = (ahead - behind) / (2.0 * STEP)
        scale = 1.0 + np.abs(expected).max()
        assert np.abs(seen.by_rig[:, :, column] - expected).max() < 1e-6 * scale, column
    for axis in range(3):
        shift = STEP * np.eye(3)[axis]
        expected = (rig.project(points + shift)[side] - rig.project(points - shift)[side]) / (
            2.0 * STEP
        )
        np.testing.assert_allclose(seen.by_point[:, :, axis], expected, rtol=1e-6, atol=1e-4)


def test_a_skewed_equidistant_camera_keeps_its_skew(points: np.ndarray) -> None:
    camera = PinholeCamera(SKEWED, [0.1, 0.01, 0.0, 0.0], (1280, 960), 'equidistant')
    straight = StereoRig(camera, camera, np.eye(3), [-0.2, 0.0, 0.0])
    state = RigState.of(straight)
    seen = project(state, 0, points)
    np.testing.assert_allclose(seen.pixels, camera.project(points), atol=1e-10)
    names = [name for name in state.names if name.startswith('left')]
    for column in range(len(names)):
        step = STEP * (np.arange(len(state.names)) == column)
        ahead, behind = (state.plus(s).cameras[0].pinhole().project(points) for s in (step, -step))
        expected = (ahead - behind) / (2.0 * STEP)
        np.testing.assert_allclose(seen.by_rig[:, :, column], expected, rtol=1e-6, atol=1e-6)


def test_minus_undoes_plus(rig: StereoRig) -> None:
    state = RigState.of(rig)
    change = 1e-3 * np.random.default_rng(1).normal(size=len(state.names))
    np.testing.assert_allclose(state.plus(change).minus(state), change, atol=1e-12)


def test_surface_names_are_those_of_the_rig(rig: StereoRig) -> None:
    surfaces = {name for name in rig.parameter_names if not name.endswith('indices.0')}
    assert surfaces <= set(RigState.of(rig).names)


def test_points_before_the_surface_have_no_pixel() -> None:
    left = PinholeCamera(MATRIX, [], (1280, 960))
    rig = StereoRig(left, left, np.eye(3), [-0.2, 0.0, 0.0], **SURFACES['surface'])
    seen = project(RigState.of(rig), 0, np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 1.2]]))
    assert np.isnan(seen.pixels[0]).all()
    assert np.isfinite(seen.pixels[1]).all()
