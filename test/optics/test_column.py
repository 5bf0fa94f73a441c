"""Layered water against the ray in a continuous gradient, and the mean index of a column."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from binopos_ros.optics import (
    FlatInterface,
    OpticsError,
    PinholeCamera,
    StereoRig,
    graded_interface,
    mean_index,
)

CAMERA = PinholeCamera([[800.0, 0, 640], [0, 800, 480], [0, 0, 1]], (), (1280, 960))


def salt(depth: float) -> float:
    """Index of water that grows saltier downwards over 0.4 m."""
    return 1.333 + 0.045 / (1 + np.exp(-(depth - 0.2) / 0.04))


def pixel_in_gradient(radius: float, depth: float) -> float:
    """Column of a point's pixel, from dr/dz = p / sqrt(n(z)^2 - p^2) integrated by scipy."""

    def miss(p: float) -> float:
        run, _ = quad(lambda z: p / np.sqrt(salt(z) ** 2 - p * p), 0, depth, epsabs=1e-13)
        return 0.8 * p / np.sqrt(1 - p * p) + run - radius

    p = brentq(miss, 0, 0.95, xtol=1e-15)
    return 640 + 800 * p / np.sqrt(1 - p * p)


def test_thin_layers_converge_to_the_curved_ray() -> None:
    """Twice the layers, a quarter of the error; 160 layers are good to a thousandth of a pixel."""
    radius, depth = np.array([0.1, 0.3, 0.5]), 0.4
    expected = [pixel_in_gradient(r, depth + 1e-9) for r in radius]
    points = np.column_stack([radius, 0 * radius, np.full(3, 0.8 + depth + 1e-9)])
    errors = []
    for layers in (20, 40, 80, 160):
        surface = graded_interface((0, 0, 1), 0.8, 1.0, salt, depth, layers)
        rig = StereoRig(CAMERA, CAMERA, np.eye(3), (-0.23, 0, 0), surface)
        errors.append(np.abs(rig.project(points)[0][:, 0] - expected).max())
    assert errors[-1] < 1e-3
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.2)


@pytest.mark.parametrize('degrees', [0.0, 20.0, 60.0, 85.0])
def test_a_homogeneous_column_of_the_mean_index_displaces_the_ray_alike(degrees: float) -> None:
    indices, layers = [1.333, 1.35, 1.37], [0.1, 0.2, 0.05]
    pixel = CAMERA.project([np.sin(np.radians(degrees)), 0, np.cos(np.radians(degrees))])
    mean = mean_index(indices, layers, invariant=np.sin(np.radians(degrees)))
    landings = []
    for column in (
        FlatInterface((0, 0, 1), 0.8, (1.0, *indices), layers[:2]),
        FlatInterface((0, 0, 1), 0.8, (1.0, mean)),
    ):
        rig = StereoRig(CAMERA, CAMERA, np.eye(3), (-0.23, 0, 0), column)
        (start, direction), _ = rig.back_project(pixel, pixel)
        landings.append(start + direction * (0.8 + sum(layers) - start[2]) / direction[2])
    np.testing.assert_allclose(landings[0], landings[1], atol=1e-14)


def test_along_the_normal_the_mean_is_what_apparent_depth_shows() -> None:
    indices, layers = [1.333, 1.4], [0.3, 0.1]
    assert mean_index(indices, layers) == pytest.approx(0.4 / (0.3 / 1.333 + 0.1 / 1.4))


def test_the_mean_hardly_depends_on_the_ray() -> None:
    """At 60 degrees in air the mean of a strong gradient has moved by its variance over it."""
    indices = np.linspace(1.33, 1.38, 50)
    layers = np.full(50, 0.01)
    change = mean_index(indices, layers, np.sin(np.radians(60))) - mean_index(indices, layers)
    assert change == pytest.approx(-indices.var() / indices.mean(), rel=0.1)


@pytest.mark.parametrize(
    ('arguments', 'says'),
    [
        (([1.3], [0.1, 0.2]), 'one thickness per index'),
        (([], []), 'one thickness per index'),
        (([0.9], [0.1]), 'indices of 1 or more'),
        (([1.3], [-0.1]), 'not negative'),
        (([1.3], [0.0]), 'not negative'),
        (([1.3], [0.1], 1.31), 'does not pass'),
    ],
)
def test_impossible_columns_are_refused(arguments: tuple, says: str) -> None:
    with pytest.raises(OpticsError, match=says):
        mean_index(*arguments)


def test_gradients_without_layers_or_depth_are_refused() -> None:
    with pytest.raises(OpticsError, match='graded water needs'):
        graded_interface((0, 0, 1), 0.8, 1.0, salt, 0.0)
    with pytest.raises(OpticsError, match='graded water needs'):
        graded_interface((0, 0, 1), 0.8, 1.0, salt, 0.1, 0)
