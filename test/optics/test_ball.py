"""A ball's outline, against the cone in the air and against lines of sight traced by the book."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.optics import DomePort, FlatInterface, OpticsError, PinholeCamera, StereoRig
from binopos_ros.optics.ball import ball_outlines

FOCAL, PRINCIPAL = 900.0, np.array([319.5, 239.5])
MATRIX = np.array([[FOCAL, 0, PRINCIPAL[0]], [0, FOCAL, PRINCIPAL[1]], [0, 0, 1]])
TO_THE_RIGHT = np.array([0.23, 0.0, 0.0])


def rig_of(interface=None):
    camera = PinholeCamera(MATRIX, (), (640, 480))
    return StereoRig(camera, camera, np.eye(3), -TO_THE_RIGHT, interface)


@pytest.mark.parametrize('place', [(0.0, 0.0, 0.9), (0.25, -0.1, 0.8), (-0.2, 0.2, 1.4)])
def test_in_the_air_the_outline_is_that_of_a_cone(place):
    centre, radius = np.array(place), 0.03
    outlines = ball_outlines(rig_of().project, centre, 2 * radius)
    for outline, seen_from in zip(outlines, (np.zeros(3), TO_THE_RIGHT), strict=True):
        x, y, z = centre - seen_from
        # The cone (p c)^2 = (c^2 - r^2) p^2 cut with the plane z = 1; its middle by its polar.
        apart = np.outer((x, y, z), (x, y, z)) - (x * x + y * y + z * z - radius**2) * np.eye(3)
        middle = np.linalg.solve(apart[:2, :2], -apart[:2, 2])
        truth = FOCAL * (middle - np.array([x, y]) / z)
        assert outline.offset == pytest.approx(truth, abs=2e-5)
        # The cone cuts the plane in an ellipse whose long axis points at the principal point.
        near, far = (
            np.tan(
                np.arctan(np.hypot(x, y) / z)
                + sign * np.arcsin(radius / np.linalg.norm((x, y, z)))
            )
            for sign in (-1, 1)
        )
        assert outline.across == pytest.approx(FOCAL * (far - near), rel=0.004)


def sight(pixel, normal, depth, index):
    """Where a pixel's ray enters the water and how it goes on, by the vector form of Snell."""
    air = np.append((pixel - PRINCIPAL) / FOCAL, 1)
    air /= np.linalg.norm(air)
    along = air @ normal
    inside = np.sqrt(1 - (1 - along**2) / index**2)
    return air * depth / along, air / index + (inside - along / index) * normal


@pytest.mark.parametrize('tilt', [0.0, 0.3])
def test_under_water_lines_of_sight_touch_the_ball_along_the_outline(tilt):
    normal, depth, index = np.array([np.sin(tilt), 0, np.cos(tilt)]), 0.6, 1.333
    rig = rig_of(FlatInterface(tuple(normal), depth, (1.0, index)))
    centre, radius = np.array([0.15, 0.1, 1.0]), 0.04
    (middle,) = rig.project(centre[None])[0]
    outline = ball_outlines(rig.project, centre, 2 * radius)[0]

    def passes_by(pixel):
        point, along = sight(pixel, normal, depth, index)
        return np.linalg.norm(np.cross(centre - point, along)) / np.linalg.norm(along) - radius

    rim = []
    for angle in np.linspace(0, 2 * np.pi, 400, endpoint=False):
        way = np.array([np.cos(angle), np.sin(angle)])
        near, far = 0.0, 90.0
        for _ in range(45):
            half = (near + far) / 2
            near, far = (near, half) if passes_by(middle + half * way) > 0 else (half, far)
        rim.append(near * way)
    x, y = np.array(rim).T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    truth = np.array([(x + nx) @ cross, (y + ny) @ cross]) / (3 * cross.sum())
    assert np.linalg.norm(truth) > 0.1
    assert outline.offset == pytest.approx(truth, abs=2e-3)
    longest = np.hypot(x[:200] - x[200:], y[:200] - y[200:]).max()
    assert outline.across == pytest.approx(longest, rel=0.01)


def test_behind_a_dome_lines_of_sight_touch_the_ball_along_the_outline():
    dome = DomePort((0.01, -0.02, 0.015), 0.05, 0.006, (1.0, 1.49, 1.333))
    camera = PinholeCamera(MATRIX, (), (640, 480))
    rig = StereoRig(camera, camera, np.eye(3), -TO_THE_RIGHT, None, dome, dome)
    centre, radius = np.array([0.15, 0.1, 0.7]), 0.04
    (middle,) = rig.project(centre[None])[0]
    outline = ball_outlines(rig.project, centre, 2 * radius)[0]
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    ways = np.column_stack([np.cos(angles), np.sin(angles)])
    near, far = np.zeros(400), np.full(400, 120.0)
    for _ in range(45):
        half = (near + far) / 2
        pixels = middle + half[:, None] * ways
        (start, along), _ = rig.back_project(pixels, pixels)
        passes = np.linalg.norm(np.cross(centre - start, along), axis=1) > radius
        near, far = np.where(passes, near, half), np.where(passes, half, far)
    x, y = (near[:, None] * ways).T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    truth = np.array([(x + nx) @ cross, (y + ny) @ cross]) / (3 * cross.sum())
    assert np.linalg.norm(truth) > 0.1
    assert outline.offset == pytest.approx(truth, abs=2e-3)
    longest = np.hypot(x[:200] - x[200:], y[:200] - y[200:]).max()
    assert outline.across == pytest.approx(longest, rel=0.01)


def test_a_ball_that_reaches_out_of_the_water_is_refused():
    rig = rig_of(FlatInterface((0.0, 0.0, 1.0), 0.6, (1.0, 1.333)))
    with pytest.raises(OpticsError, match='not seen whole'):
        ball_outlines(rig.project, np.array([0.0, 0.0, 0.61]), 0.06)
