"""The simulator's lens against OpenCV's, an independent one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.lens import Lens
from binopos_ros.simulation.presets import TABLE_1
from binopos_ros.simulation.wide_lens import WideLens

MATRIX = np.array([[900.0, 0, 626.2], [0, 904.5, 494.3], [0, 0, 1]])
SIZE = (1280, 960)
DISTORTIONS = [
    (),
    *TABLE_1,
    (-0.3, 0.12, 0.001, -0.002, -0.02),
    (0.4, -0.1, 0.001, -0.0005, 0.02, 0.7, 0.05, 0.01),
]


def pixels() -> np.ndarray:
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 33), np.linspace(0, SIZE[1] - 1, 25))
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.mark.parametrize('terms', DISTORTIONS)
def test_opencv_projects_the_rays_back_to_their_pixels(terms: tuple[float, ...]) -> None:
    lens = Lens(MATRIX, terms, SIZE)
    rays = lens.directions(pixels())
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-14)
    back, _ = cv2.projectPoints(
        rays, np.zeros(3), np.zeros(3), MATRIX, np.array(terms or (0.0,) * 4)
    )
    np.testing.assert_allclose(back[:, 0], pixels(), atol=1e-9)
    np.testing.assert_allclose(lens.pixels(rays), pixels(), atol=1e-9)


@pytest.mark.parametrize('terms', [(0.0,) * 4, (0.09, -0.02, 0.004, -0.0005)])
def test_opencv_projects_the_rays_of_a_wide_lens_back_to_their_pixels(
    terms: tuple[float, ...],
) -> None:
    matrix = np.array([[580.0, 0, 626.2], [0, 583.5, 494.3], [0, 0, 1]])
    lens = WideLens(matrix, terms, SIZE)
    rays = lens.directions(pixels())
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-14)
    back, _ = cv2.fisheye.projectPoints(
        rays[:, None], np.zeros(3), np.zeros(3), matrix, np.array(terms)
    )
    np.testing.assert_allclose(back[:, 0], pixels(), atol=1e-9)
    np.testing.assert_allclose(lens.pixels(rays), pixels(), atol=1e-9)


def test_a_wide_lens_whose_image_shows_what_no_ray_reaches_is_refused() -> None:
    with pytest.raises(SimulationError, match='more than 90 degrees'):
        WideLens(np.array([[300.0, 0, 640], [0, 300, 480], [0, 0, 1]]), np.zeros(4), SIZE)
    with pytest.raises(SimulationError, match='folds over'):
        WideLens(MATRIX, (-0.9, 0.0, 0, 0), SIZE)


def test_a_lens_that_folds_over_in_the_image_is_refused() -> None:
    with pytest.raises(SimulationError, match='folds over'):
        Lens(MATRIX, (-0.9, 0.0, 0, 0), SIZE)


def test_terms_that_it_does_not_know_are_refused() -> None:
    with pytest.raises(SimulationError, match='12 terms'):
        Lens(MATRIX, np.full(12, 1e-3), SIZE)


@pytest.mark.parametrize('focal', [800, 900, 1000])
@pytest.mark.parametrize('terms', TABLE_1)
def test_table_1_of_the_paper_is_one_to_one_over_the_whole_image(
    focal: float, terms: tuple[float, ...]
) -> None:
    """The Jacobian by finite differences keeps its sign over the field, with room to spare."""
    matrix = np.array([[focal, 0, 626.2], [0, focal, 494.3], [0, 0, 1]])
    lens = Lens(matrix, terms, SIZE)
    rays = lens.directions(pixels())
    plane = rays[:, :2] / rays[:, 2:]
    step = 1e-6
    columns = []
    for axis in range(2):
        shifted = np.column_stack([plane, np.ones(len(plane))])
        shifted[:, axis] += step
        columns.append((lens.pixels(shifted) - pixels()) / step / focal)
    determinant = columns[0][:, 0] * columns[1][:, 1] - columns[0][:, 1] * columns[1][:, 0]
    assert determinant.min() > 0.75
