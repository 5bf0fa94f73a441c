"""The ray's equation through parallel planes, against the angle that made the point."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from binopos_ros.optics import stack as stack_module
from binopos_ros.optics.arithmetic import ARRAYS, FLOATS
from binopos_ros.optics.stack import ParallelStack

Layers = tuple[tuple[float, ...], tuple[float, ...]]
STEEPEST = np.radians(89.0)


def landing(indices: np.ndarray, layers: np.ndarray, tangent: np.ndarray) -> np.ndarray:
    """Return how far from the normal a ray lands that leaves the camera at this tangent.

    Snell's law layer by layer, in extended precision: n^2 cos^2 = n^2 - n_0^2 sin^2, written so
    that nothing cancels towards grazing.
    """
    n = np.asarray(indices, dtype=np.longdouble)
    tangent = np.asarray(tangent, dtype=np.longdouble)[:, None]
    first = n[0] * n[0]
    upright = n * n - first + first / (1 + tangent * tangent)
    sine = n[0] * tangent / np.sqrt(1 + tangent * tangent)
    return (layers * sine / np.sqrt(upright)).sum(axis=1)


def steepest_tangent(indices: np.ndarray) -> float:
    """Return the tangent at the camera where the lightest medium's angle is 89 degrees."""
    sine = min(indices) * np.sin(STEEPEST) / indices[0]
    return float(sine / np.sqrt(1 - sine * sine))


def check(indices: np.ndarray, thicknesses: np.ndarray, height: float) -> None:
    """Points made by 200 angles up to 89 degrees must give their angles back."""
    tangents = np.linspace(0.0, steepest_tangent(indices), 200)
    layers = np.array([*thicknesses, height])
    r = landing(indices, layers, tangents).astype(float)
    bend = ParallelStack(tuple(indices), tuple(thicknesses))
    found = r * bend.slope(r * r, np.full(200, height), ARRAYS)
    again = landing(indices, layers, found)
    # Near total reflection a last digit of the direction itself moves the landing far.
    last_digits = landing(indices, layers, found * (1 + np.longdouble(1e-15))) - again
    assert (np.abs(again - r) <= 2e-14 * r + 2 * last_digits).all()


@pytest.mark.parametrize('height', [1e-6, 1e-3, 0.1, 1.0, 100.0])
@pytest.mark.parametrize('distance', [1e-3, 0.02, 1.0, 10.0])
def test_six_steps_are_enough_up_to_89_degrees(
    stack: Layers, height: float, distance: float
) -> None:
    assert stack_module.MAX_ITERATIONS == 6
    indices, thicknesses = stack
    check(np.array(indices), np.array([distance, *thicknesses]), height)


@settings(deadline=None)
@example(indices=[1.0, 1.0, 1.0, 1.0000000000000002], scales=[0.0, 0.0, 0.0, 2.0, 0.0, 0.0])
@example(indices=[1.0474088907105064, 1.046875], scales=[0.0] * 6)
@given(
    indices=st.lists(st.floats(1.0, 2.5), min_size=2, max_size=6),
    scales=st.lists(st.floats(-5.0, 2.0), min_size=6, max_size=6),
)
def test_six_steps_are_enough_for_any_layers(indices: list[float], scales: list[float]) -> None:
    layers = 10.0 ** np.array(scales)[: len(indices)]
    check(np.array(indices), layers[:-1], float(layers[-1]))


def test_equal_indices_are_the_straight_line_exactly() -> None:
    bend = ParallelStack((1.33, 1.33, 1.33), (0.25, 0.5))
    rho, height = np.array([0.0, 0.1, 4.0]), np.array([0.25, 1.25, 0.25])
    np.testing.assert_array_equal(bend.slope(rho, height, ARRAYS), 1 / (0.75 + height))


def test_floats_and_arrays_run_the_same_lines(stack: Layers) -> None:
    indices, thicknesses = stack
    bend = ParallelStack(indices, (0.3, *thicknesses))
    rho, height = np.random.default_rng(0).uniform(0, 3, (2, 50))
    batch = np.array([*bend.bend(rho, height, ARRAYS)])
    single = np.array([bend.bend(*pair, FLOATS) for pair in zip(rho, height, strict=True)])
    np.testing.assert_allclose(single, batch.T, rtol=1e-12)


def test_derivatives_agree_with_differences(stack: Layers) -> None:
    indices, thicknesses = stack
    rho, height = np.random.default_rng(1).uniform(0.05, 2, (2, 50))
    h = 1e-6

    def slope(rho: np.ndarray, height: np.ndarray, last: float) -> np.ndarray:
        layers = ParallelStack((*indices[:-1], last), (0.3, *thicknesses))
        return layers.slope(rho, height, ARRAYS)

    bend = ParallelStack(indices, (0.3, *thicknesses)).bend(rho, height, ARRAYS)
    last = indices[-1]
    differences = (
        slope(rho + h, height, last) - slope(rho - h, height, last),
        slope(rho, height + h, last) - slope(rho, height - h, last),
        slope(rho, height, last + h) - slope(rho, height, last - h),
    )
    for analytic, difference in zip(bend[1:], differences, strict=True):
        scale = np.abs(analytic).max()
        np.testing.assert_allclose(analytic, difference / (2 * h), atol=1e-6 * scale)
