"""Traced rays against Fermat: light takes the way of least time. Snell's law is not used here."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import minimize

from binopos_ros.simulation.medium import Boundary, plane_axes, refract, trace
from binopos_ros.simulation.presets import salt_gradient
from binopos_ros.simulation.waves import WaveSpectrum

Array = NDArray[np.float64]
NORMAL = np.array([0.1, -0.2, 1.0]) / np.linalg.norm([0.1, -0.2, 1.0])


def stack(indices: tuple[float, ...], thicknesses: tuple[float, ...]) -> tuple[Boundary, ...]:
    distances = 0.8 + np.concatenate([[0], np.cumsum(thicknesses)])
    return tuple(
        Boundary(NORMAL, float(distance), before, after)
        for distance, before, after in zip(distances, indices[:-1], indices[1:], strict=True)
    )


def directions(count: int, widest: float, seed: int) -> Array:
    """Unit rays up to `widest` radians off the normal."""
    rng = np.random.default_rng(seed)
    first, second = plane_axes(NORMAL)
    angle, turn = rng.uniform(0, widest, count), rng.uniform(0, 2 * np.pi, count)
    across = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    return np.cos(angle)[:, None] * NORMAL + np.sin(angle)[:, None] * across


def least_time(boundaries: tuple[Boundary, ...], start: Array, end: Array, time: float) -> Array:
    """Where the quickest way from start to end crosses the first boundary."""
    first, second = plane_axes(NORMAL)

    def crossings(places: Array) -> list[Array]:
        points = []
        for boundary, (x, y) in zip(boundaries, places.reshape(-1, 2), strict=True):
            height = 0.0
            if boundary.waves is not None:
                height = float(
                    boundary.waves.height_and_slope(np.array([x]), np.array([y]), time)[0][0]
                )
            points.append(x * first + y * second + (boundary.distance - height) * NORMAL)
        return points

    def duration(places: Array) -> float:
        points = [start, *crossings(places), end]
        indices = [boundaries[0].index_before, *(b.index_after for b in boundaries)]
        legs = zip(indices, points[:-1], points[1:], strict=True)
        return float(sum(n * np.linalg.norm(b - a) for n, a, b in legs))

    share = (boundaries[0].distance - start @ NORMAL) / ((end - start) @ NORMAL)
    guess = start + share * (end - start)
    guess_xy = np.tile([guess @ first, guess @ second], len(boundaries))
    found = minimize(duration, guess_xy, method='BFGS', options={'gtol': 1e-13})
    found = minimize(duration, found.x, method='Nelder-Mead', options={'xatol': 1e-12, 'fatol': 0})
    return crossings(found.x)[0]


@pytest.mark.parametrize(
    ('indices', 'thicknesses'),
    [((1.0, 1.333), ()), ((1.0, 1.517, 1.335), (0.03,)), ((1.333, 1.0), ())],
)
def test_flat_stacks_obey_least_time(
    indices: tuple[float, ...], thicknesses: tuple[float, ...]
) -> None:
    boundaries = stack(indices, thicknesses)
    widest = 0.6 if indices[-1] < indices[0] else 1.2
    rays = trace(boundaries, np.zeros(3), directions(6, widest, 1), 0.0)
    targets = rays.origins + 0.4 * rays.directions
    for entry, target in zip(rays.entries, targets, strict=True):
        # Time is flat at its minimum: rounding limits the crossing to about its root.
        np.testing.assert_allclose(
            least_time(boundaries, np.zeros(3), target, 0.0), entry, atol=5e-7
        )


def test_a_wavy_surface_obeys_least_time() -> None:
    waves = WaveSpectrum(0.0008, depth=0.49).realise(np.random.default_rng(4))
    boundaries = (Boundary(NORMAL, 0.8, 1.0, 1.333, waves),)
    rays = trace(boundaries, np.zeros(3), directions(6, 0.6, 2), 0.37)
    targets = rays.origins + 0.05 * rays.directions
    for entry, target in zip(rays.entries, targets, strict=True):
        np.testing.assert_allclose(
            least_time(boundaries, np.zeros(3), target, 0.37), entry, atol=5e-7
        )


def test_rays_meet_the_waves_themselves() -> None:
    waves = WaveSpectrum(0.002, depth=0.49).realise(np.random.default_rng(5))
    rays = trace(
        (Boundary(NORMAL, 0.8, 1.0, 1.333, waves),), np.zeros(3), directions(500, 0.9, 3), 1.2
    )
    first, second = plane_axes(NORMAL)
    height, *_ = waves.height_and_slope(rays.entries @ first, rays.entries @ second, 1.2)
    np.testing.assert_allclose(0.8 - rays.entries @ NORMAL, height, atol=1e-10)


def test_the_invariant_of_a_salt_gradient_is_kept_through_all_its_layers() -> None:
    """In parallel layers n sin(angle) is the same in the first and in the last."""
    indices, thicknesses = salt_gradient(1.333, 1.375, 0.49)
    boundaries = stack((1.0, *indices), thicknesses)
    start = directions(100, 1.3, 6)
    rays = trace(boundaries, np.zeros(3), start, 0.0)
    before = np.linalg.norm(np.cross(start, NORMAL), axis=1)
    after = indices[-1] * np.linalg.norm(np.cross(rays.directions, NORMAL), axis=1)
    np.testing.assert_allclose(after, before, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(rays.directions, axis=1), 1, atol=1e-13)
    # The ray stays in the plane of the normal and its first direction.
    side = np.cross(start, NORMAL)
    np.testing.assert_allclose(np.sum(side * rays.directions, axis=1), 0, atol=1e-13)


@given(
    angle=st.floats(0.0, 1.5),
    turn=st.floats(0.0, 6.3),
    ratio=st.floats(0.6, 1.7),
)
def test_refraction_is_reversible(angle: float, turn: float, ratio: float) -> None:
    normal = NORMAL
    first, second = plane_axes(normal)
    across = np.cos(turn) * first + np.sin(turn) * second
    ray = (np.cos(angle) * normal + np.sin(angle) * across)[None, :]
    beyond = refract(ray, normal, ratio)
    if ratio * np.sin(angle) > 1:
        assert np.isnan(beyond).all()
    elif ratio * np.sin(angle) < 1 - 1e-9:
        np.testing.assert_allclose(refract(beyond, normal, 1 / ratio), ray, atol=1e-6)


def test_total_reflection_gives_nan() -> None:
    angle = np.arcsin(1 / 1.333)
    normal = np.array([0, 0, 1.0])
    below, above = (np.array([[np.sin(a), 0, np.cos(a)]]) for a in (angle - 1e-6, angle + 1e-6))
    assert np.isfinite(refract(below, normal, 1.333)).all()
    assert np.isnan(refract(above, normal, 1.333)).all()


def test_rays_that_leave_the_boundary_behind_give_nan() -> None:
    rays = trace(stack((1.0, 1.333), ()), np.zeros(3), -directions(5, 0.5, 7), 0.0)
    assert np.isnan(rays.directions).all()
