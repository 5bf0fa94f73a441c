"""The camera against OpenCV's own projection, and against itself backwards."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.optics import OpticsError, PinholeCamera

MATRIX = np.array([[800.0, 0.0, 640.0], [0.0, 805.0, 480.0], [0.0, 0.0, 1.0]])
SIZE = (1280, 960)
TERMS = np.array(
    [-0.2, 0.05, 1e-3, -2e-3, 0.01, 0.02, 0.01, 0.001, 1e-3, 2e-4, -1e-3, 1e-4, 0.02, -0.03]
)
FAMILIES = [0, 4, 5, 8, 12, 14]


def corner_to_corner() -> np.ndarray:
    """Pixels over the whole image and a little beyond, (N, 2)."""
    u, v = np.meshgrid(np.linspace(-40, 1320, 23), np.linspace(-40, 1000, 19))
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.mark.parametrize('count', FAMILIES)
def test_projection_is_opencvs(count: int) -> None:
    points = np.random.default_rng(1).uniform([-0.8, -0.6, 1.0], [0.8, 0.6, 2.0], (500, 3))
    terms = TERMS[:count]
    expected = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), MATRIX, terms if count else None
    )[0][:, 0]
    pixels = PinholeCamera(MATRIX, terms, SIZE).project(points)
    np.testing.assert_allclose(pixels, expected, atol=1e-10)


@pytest.mark.parametrize('count', FAMILIES)
def test_unproject_inverts_project_to_rounding(count: int) -> None:
    camera = PinholeCamera(MATRIX, TERMS[:count], SIZE)
    pixels = corner_to_corner()
    rays = camera.unproject(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-15)
    np.testing.assert_allclose(camera.project(rays), pixels, atol=2e-12)


def test_skew_follows_equation_3() -> None:
    camera = PinholeCamera([[800, 5, 640], [0, 805, 480], [0, 0, 1]], (), SIZE)
    np.testing.assert_allclose(
        camera.project([0.1, 0.2, 1.0]), [800 * 0.1 + 5 * 0.2 + 640, 805 * 0.2 + 480], atol=1e-12
    )
    np.testing.assert_allclose(camera.project(camera.unproject([30.0, 50.0])), [30.0, 50.0])


@pytest.mark.parametrize('count', FAMILIES)
def test_jacobian_agrees_with_differences(count: int) -> None:
    camera = PinholeCamera(MATRIX, TERMS[:count], SIZE)
    x, y = np.random.default_rng(2).uniform(-0.6, 0.6, (2, 200))
    h = 1e-6
    _, _, *analytic = camera.pixels_with_jacobian(x, y)
    across = np.subtract(camera.pixels(x + h, y), camera.pixels(x - h, y)) / (2 * h)
    down = np.subtract(camera.pixels(x, y + h), camera.pixels(x, y - h)) / (2 * h)
    for got, expected in zip(analytic, (across[0], down[0], across[1], down[1]), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)


def test_beyond_the_fold_there_is_no_pixel() -> None:
    """With k1 = -0.4 the image turns back at r^2 = 1 / 1.2; OpenCV would go on into it."""
    camera = PinholeCamera(MATRIX, [-0.4, 0.0, 0.0, 0.0], SIZE)
    fold = np.sqrt(1 / 1.2)
    inside, outside = 0.999 * fold, 1.001 * fold
    assert np.isfinite(camera.project([inside, 0.0, 1.0])).all()
    assert np.isnan(camera.project([outside, 0.0, 1.0])).all()
    np.testing.assert_allclose(
        camera.unproject(camera.project([inside, 0.0, 1.0])),
        np.array([inside, 0.0, 1.0]) / np.hypot(inside, 1.0),
        atol=1e-9,
    )
    last_pixel = 640 + 800 * fold * (1 - 0.4 * fold**2)
    assert np.isfinite(camera.unproject([last_pixel - 0.01, 480.0])).all()
    assert np.isnan(camera.unproject([last_pixel + 0.01, 480.0])).all()


def test_rational_lens_stops_at_its_pole() -> None:
    camera = PinholeCamera(MATRIX, [0, 0, 0, 0, 0, -0.5, 0, 0], SIZE)
    assert np.isfinite(camera.project([1.0, 0.0, 1.0])).all()
    assert np.isnan(camera.project([1.5, 0.0, 1.0])).all()


@pytest.mark.parametrize('point', [(0, 0, 0), (0.1, 0.1, -1), (np.nan, 0, 1), (np.inf, 0, 1)])
def test_points_that_no_camera_sees(point: tuple[float, ...]) -> None:
    assert np.isnan(PinholeCamera(MATRIX, TERMS[:5], SIZE).project(point)).all()


def test_a_single_point_and_none_at_all_keep_their_shapes() -> None:
    camera = PinholeCamera(MATRIX, TERMS[:5], SIZE)
    assert camera.project([0, 0, 1]).shape == (2,)
    assert camera.unproject([0, 0]).shape == (3,)
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)
    assert camera.unproject(np.zeros((0, 2))).shape == (0, 3)


@settings(deadline=None)
@given(
    radial=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.02, 0.02)),
    tangential=st.tuples(st.floats(-5e-3, 5e-3), st.floats(-5e-3, 5e-3)),
    x=st.floats(-0.7, 0.7),
    y=st.floats(-0.7, 0.7),
)
def test_every_pixel_there_is_comes_back(
    radial: tuple[float, ...], tangential: tuple[float, ...], x: float, y: float
) -> None:
    """Whatever the lens, what it images inside its field unprojects to where it came from."""
    camera = PinholeCamera(MATRIX, [*radial[:2], *tangential, radial[2]], SIZE)
    pixel = camera.project([x, y, 1.0])
    if np.isnan(pixel).any():
        assert x * x + y * y >= camera.lens.fold_radius_squared
        return
    ray = camera.unproject(pixel)
    if np.isnan(ray).any() or x * x + y * y > 0.9 * camera.lens.fold_radius_squared:
        return  # at the fold itself the inverse has no derivative
    np.testing.assert_allclose(ray[:2] / ray[2], [x, y], atol=1e-9)


@pytest.mark.parametrize(
    ('matrix', 'terms', 'size', 'says'),
    [
        (np.zeros((3, 3)), (), SIZE, 'uncalibrated'),
        (np.diag([np.nan, 1, 1]), (), SIZE, 'not finite'),
        (np.diag([-800, 800, 1]), (), SIZE, 'focal lengths must be positive'),
        (np.eye(4), (), SIZE, 'must be 3x3'),
        (MATRIX.T, (), SIZE, 'upper triangular'),
        (MATRIX, np.zeros(6), SIZE, '6 terms'),
        (MATRIX, [0, 0, 0, np.inf], SIZE, 'not finite'),
        (MATRIX, (), (0, 10), 'image size'),
        (MATRIX, (), (10.5, 10), 'image size'),
    ],
)
def test_impossible_cameras_are_refused_in_one_line(
    matrix: np.ndarray, terms: np.ndarray, size: tuple[float, float], says: str
) -> None:
    with pytest.raises(OpticsError, match=says) as caught:
        PinholeCamera(matrix, terms, size)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('points', [np.zeros((3, 2)), np.zeros((2, 2, 3)), np.zeros(4)])
def test_wrong_shapes_are_refused(points: np.ndarray) -> None:
    with pytest.raises(OpticsError, match='shape'):
        PinholeCamera(MATRIX, (), SIZE).project(points)
