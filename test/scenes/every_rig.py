"""Rigs of every kind, and what their pixels tell of a point, without the code under test."""

from __future__ import annotations

import numpy as np

from binopos_ros.optics import (
    DomePort,
    FlatInterface,
    PinholeCamera,
    StereoRig,
    graded_interface,
)

AIR, GLASS, WATER = 1.0, 1.46, 1.333


def turn(x: float, y: float) -> np.ndarray:
    """Turn about x, then y, rad."""
    cx, sx, cy, sy = np.cos(x), np.sin(x), np.cos(y), np.sin(y)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    return np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]) @ about_x


def lens(
    focal: float = 900.0, terms: tuple[float, ...] = (-0.1, 0.02, 1e-3, -5e-4, 0)
) -> PinholeCamera:
    """A camera of 1280 x 960 pixels."""
    return PinholeCamera([[focal, 0, 640], [0, focal, 480], [0, 0, 1]], terms, (1280, 960))


def wide_lens() -> PinholeCamera:
    """A camera with an equidistant lens, which sees 75 degrees off its axis in the corners."""
    terms = (0.012, -0.006, 0.002, -0.0003)
    return PinholeCamera(
        [[620, 0, 640], [0, 621, 480], [0, 0, 1]], terms, (1280, 960), 'equidistant'
    )


def make_rigs() -> dict[str, StereoRig]:
    """Rigs from the washbowl of the paper to domes and a housing before a leaning tank wall."""
    wide, apart = (np.eye(3), (-0.23, 0, 0)), (turn(0.02, 0.25), (-0.4, 0.01, 0.05))
    surface = FlatInterface((0, 0, 1), 0.8, (AIR, WATER))
    tilted = FlatInterface((0.3, -0.1, 1), 0.7, (AIR, WATER))
    pane = FlatInterface((0.05, 0.02, 1), 0.5, (AIR, GLASS, WATER), (0.012,))
    port = FlatInterface((0, 0, 1), 0.02, (AIR, GLASS, WATER), (0.008,))
    other = FlatInterface((-0.05, 0.03, 1), 0.025, (AIR, GLASS, WATER), (0.008,))
    wall = FlatInterface((0, 0, 1), 0.5, (WATER, GLASS, AIR), (0.02,))
    leaning = FlatInterface((0.15, 0.1, 1), 0.6, (WATER, GLASS, AIR), (0.02,))
    salt = graded_interface((0, 0, 1), 0.6, AIR, lambda depth: WATER + 0.1 * depth, 0.3)
    level = FlatInterface((0, 0, 1), 0.02, (AIR, GLASS, WATER), (0.008,))
    dome = DomePort((0.002, -0.003, 0.015), 0.05, 0.007, (AIR, GLASS, WATER))
    other_dome = DomePort((-0.004, 0.002, -0.01), 0.06, 0.004, (AIR, GLASS, WATER))
    return {
        'air': StereoRig(lens(), lens(), *wide),
        'washbowl': StereoRig(lens(), lens(), *wide, surface),
        'converging over water': StereoRig(lens(), lens(), *apart, surface),
        'tilted surface': StereoRig(lens(), lens(800.0), *wide, tilted),
        'tank': StereoRig(lens(), lens(), *wide, pane),
        'strong distortion': StereoRig(
            lens(700, (-0.25, 0.08, 0, 0, -0.01)), lens(700, (0.1, 0.05, 0, 0, 0)), *wide, surface
        ),
        'ports': StereoRig(lens(), lens(), *apart, None, port, other),
        'ports before a wall': StereoRig(lens(), lens(), *wide, wall, level, level),
        'port before a leaning wall': StereoRig(lens(), lens(), *wide, leaning, level, other),
        'wide lenses behind domes': StereoRig(
            wide_lens(), wide_lens(), *wide, None, dome, other_dome
        ),
        'salt gradient': StereoRig(lens(), lens(), *wide, salt),
    }


RIGS = make_rigs()


def inverse_information(
    rig: StereoRig, points: np.ndarray, left_cov: np.ndarray, right_cov: np.ndarray
) -> np.ndarray:
    """Return the Cramer-Rao bound (N, 3, 3) at true points, by differencing the projection."""
    h = 1e-5
    information = np.zeros((len(points), 3, 3))
    for side, cov in ((0, left_cov), (1, right_cov)):
        jacobian = np.stack(
            [
                (rig.project(points + s)[side] - rig.project(points - s)[side]) / (2 * h)
                for s in h * np.eye(3)
            ],
            axis=-1,
        )
        information += np.swapaxes(jacobian, 1, 2) @ np.linalg.inv(cov) @ jacobian
    return np.linalg.inv(information)
