"""A disc's outline against a polygon of 2,000 corners, and few points against many."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.disc import centroid, disc_outlines


@pytest.fixture(scope='module')
def rig() -> StereoRig:
    matrix = np.array([[900.0, 0, 640], [0, 900, 480], [0, 0, 1]])
    camera = PinholeCamera(matrix, (-0.2, 0.05, 1e-3, -5e-4, 0.0), (1280, 960))
    surface = FlatInterface((0.03, 0.06, 1.0), 0.8, (1.0, 1.333))
    return StereoRig(camera, camera, np.eye(3), (-0.23, 0.0, 0.0), surface)


@pytest.mark.parametrize(('diameter', 'within'), [(0.03, 1e-5), (0.1, 1e-4), (0.2, 2e-3)])
def test_the_outline_of_a_disc_is_that_of_many_points(rig, diameter, within):
    angles = np.linspace(0, 2 * np.pi, 2001)
    rng = np.random.default_rng(4)
    for _ in range(40):
        place = rng.uniform((-0.3, -0.2, 0.98), (0.3, 0.2, 1.4))
        normal = rng.normal(size=3) - (0, 0, 2)
        first = np.cross(normal, (1, 0, 0))
        across = np.array([first, np.cross(normal, first)])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        rim = np.column_stack([np.cos(angles), np.sin(angles)]) @ across * diameter / 2
        images = rig.project(place + rim)
        centres = rig.project(place)
        outlines = disc_outlines(rig.project, place, normal, diameter)
        for image, centre, outline in zip(images, centres, outlines, strict=True):
            assert np.abs(centroid(image) - centre - outline.offset).max() < within
            longest = np.linalg.norm(image[:1000] - image[1000:2000], axis=1).max()
            assert outline.across == pytest.approx(longest, rel=diameter**2)


def test_few_points_are_projected_to_the_digits_of_many(rig):
    points = np.random.default_rng(1).uniform((-0.5, -0.5, 0.9), (0.5, 0.5, 2.0), (40, 3))
    points[3], points[5], points[7] = (0.1, 0.1, 0.0), (0.1, np.nan, 1.2), (0, 0, -1.0)
    together = np.array(rig.project(points))
    for few in (1, 3, 8):
        apart = [np.array(rig.project(points[k : k + few])) for k in range(0, 40, few)]
        assert np.array_equal(np.concatenate(apart, axis=1), together, equal_nan=True)
