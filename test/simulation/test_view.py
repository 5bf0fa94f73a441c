"""Apparent positions against least time, against the optics room, and against the trace itself."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.presets import Choices, domes, ports, washbowl
from binopos_ros.simulation.view import views_of
from binopos_ros.simulation.waves import WaveSpectrum


@pytest.mark.parametrize('make', [washbowl, ports, domes])
def test_the_trace_of_an_apparent_pixel_passes_through_the_point(make: type) -> None:
    scene = make(Choices())
    times = np.linspace(0, 9, 40)
    points = scene.path.poses(times)[0]
    for view, pixels in zip(scene.views, scene.measurements(times), strict=True):
        rays = view.look(pixels, times)
        offset = points - rays.origins
        np.testing.assert_allclose(
            np.linalg.norm(np.cross(rays.directions, offset), axis=1), 0, atol=1e-11
        )


def test_the_same_holds_through_waves() -> None:
    scene = washbowl(Choices(waves=0.0007, seed=3))
    times = np.linspace(0, 9, 60)
    points = scene.path.poses(times)[0]
    calm = washbowl(Choices(seed=3)).measurements(times)
    for view, pixels, still in zip(scene.views, scene.measurements(times), calm, strict=True):
        rays = view.look(pixels, times)
        offset = points - rays.origins
        np.testing.assert_allclose(
            np.linalg.norm(np.cross(rays.directions, offset), axis=1), 0, atol=1e-10
        )
        assert 1.0 < np.abs(pixels - still).max() < 60.0


@pytest.mark.parametrize(
    ('make', 'choices'),
    [
        (washbowl, Choices()),
        (washbowl, Choices(salt=1.37)),
        (ports, Choices()),
        (domes, Choices()),
    ],
)
def test_the_optics_room_projects_to_the_same_pixels(make: type, choices: Choices) -> None:
    """Two derivations that share no code: the forward solution and the backward trace."""
    scene = make(choices)
    rng = np.random.default_rng(1)
    times = rng.uniform(0, 9, 200)
    points = scene.path.poses(times)[0] + rng.uniform(-0.1, 0.1, (200, 3)) * [1, 1, 0.3]
    if choices.salt is not None:
        points += 0.04 * scene.rig.interface.normal
    for mine, other in zip(
        scene.measurements(times, points), scene.rig.project(points), strict=True
    ):
        np.testing.assert_allclose(mine, other, atol=1e-7)


def test_waves_displace_by_the_first_order_rule() -> None:
    """Over a depth h a slope s shifts the target by h (1 - 1/n) s, seen from straight above."""
    camera = PinholeCamera(
        np.array([[900.0, 0, 640], [0, 900, 480], [0, 0, 1]]), np.zeros(5), (1280, 960)
    )
    waves = WaveSpectrum(0.0001, depth=0.49).realise(np.random.default_rng(2))
    rig = StereoRig(
        camera, camera, np.eye(3), [-0.23, 0, 0], FlatInterface([0, 0, 1], 100.0, (1.0, 1.333))
    )
    view = views_of(rig, waves)[0]
    depth = 0.49
    point = np.array([[0.0, 0.0, 100.0 + depth]])
    times = np.linspace(0, 4, 100)
    pixels = view.apparent(np.repeat(point, 100, axis=0), times)
    # Far away, the camera's scale at the surface turns pixels to metres.
    shift = (pixels - [640, 480]) / 900 * 100.0
    _, slope_x, slope_y = waves.height_and_slope(shift[:, 0], shift[:, 1], times)
    expected = depth * (1 - 1 / 1.333) * np.column_stack([slope_x, slope_y])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(shift, -expected, atol=0.03 * scale)


def test_a_dome_before_a_wall_is_seen_as_the_optics_room_sees_it() -> None:
    rig = domes().rig
    wall = FlatInterface([0.1, 0.05, 1.0], 0.5, (1.335, 1.49, 1.0), (0.02,))
    housed = StereoRig(
        rig.left, rig.right, rig.rotation, rig.translation, wall, rig.left_port, rig.right_port
    )
    assert isinstance(housed.left_port, DomePort)
    points = np.random.default_rng(2).uniform([-0.4, -0.3, 0.7], [0.4, 0.3, 1.5], (60, 3))
    for view, expected in zip(views_of(housed), housed.project(points), strict=True):
        np.testing.assert_allclose(view.apparent(points, 0.0), expected, atol=1e-7)


def test_points_behind_the_camera_or_above_the_water_have_no_pixel() -> None:
    scene = washbowl()
    left, right = scene.measurements(np.zeros(3), [[0, 0, -1.0], [0.05, 0, 0.7], [0.05, 0, 1.2]])
    assert np.isnan(left[:2]).all()
    assert np.isnan(right[:2]).all()
    assert np.isfinite(left[2]).all()


def test_waves_on_a_rig_without_a_surface_are_refused() -> None:
    waves = WaveSpectrum(0.001).realise(np.random.default_rng(0))
    with pytest.raises(SimulationError, match='water surface'):
        views_of(ports().rig, waves)
