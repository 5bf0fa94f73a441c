"""Interfaces: the real dots of openptv-multiplane, behind glass in water."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import FlatInterface
from binopos_ros.optics.rig_state import Camera, RigState
from binopos_ros.triangulation import triangulate

PIXEL = 5.86e-6  # m, of openptv-multiplane


def read_planes(
    folder: Path, planes: tuple[int, ...]
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Dots of openptv-multiplane in metres, and their pixels in both cameras."""
    points = [np.loadtxt(folder / f'plane{p}_cam1.tif.fix')[:, 1:4] / 1000.0 for p in planes]
    left, right = (
        np.concatenate([np.loadtxt(folder / f'plane{p}_cam{c}.tif.crd')[:, 1:3] for p in planes])
        for c in (1, 2)
    )
    return np.concatenate(points), (left, right)


def read_camera(path: Path) -> tuple[Camera, Pose]:
    """An .ori file as a camera and its pose, camera_from_world (m)."""
    rows = [
        [float(word) for word in line.split()] for line in path.read_text().splitlines() if line
    ]
    rows = [row for row in rows if row]
    centre, turned = np.array(rows[0]) / 1000.0, np.array(rows[2:5])
    (x0, y0), (constant,) = rows[5], rows[6]
    focal = constant * 1e-3 / PIXEL
    place = np.array([960.0 + x0 * 1e-3 / PIXEL, 600.0 - y0 * 1e-3 / PIXEL])
    rotation = np.diag([1.0, -1.0, -1.0]) @ turned.T  # OpenPTV looks along -z, with y up
    camera = Camera(np.array([focal, focal]), place, np.zeros(0), (1920, 1200))
    return camera, Pose(rotation, -rotation @ centre)


@pytest.fixture(scope='module')
def multiplane(shared_data: Path) -> tuple[Path, RigState, FlatInterface, Pose]:
    """The published calibration: air rig, wall in the rig frame, rig_from_world."""
    folder = shared_data / 'openptv-multiplane' / 'cal'
    (left, pose), (right, other) = (read_camera(folder / f'cam{c}.tif.ori') for c in (1, 2))
    rotation = other.rotation @ pose.rotation.T
    air = RigState((left, right), rotation, other.translation - rotation @ pose.translation)
    normal = pose.rotation @ [0.0, 0.0, -1.0]
    face = pose.apply(np.array([[0.0, 0.0, 0.012]]))[0]
    wall = FlatInterface(normal, float(face @ normal), (1.0, 1.46, 1.33), (0.006,))
    return folder, air, wall, pose


def test_published_multiplane_calibration_gives_the_published_error(
    multiplane: tuple[Path, RigState, FlatInterface, Pose],
) -> None:
    folder, air, wall, pose = multiplane
    points, pixels = read_planes(folder, (1, 2, 3, 4))
    rig = replace(air, interfaces={'interface': wall}).rig()
    error = triangulate(rig, *pixels).points - pose.apply(points)
    assert 1000.0 * np.sqrt(np.mean(np.sum(error**2, axis=1))) == pytest.approx(0.704, abs=0.01)


@pytest.mark.parametrize('start', ['published wall', 'unknown wall'])
def test_multiplane_refit_beats_the_held_out_figure(
    multiplane: tuple[Path, RigState, FlatInterface, Pose], start: str
) -> None:
    folder, air, wall, _ = multiplane
    train, pixels = read_planes(folder, (1, 2, 4))
    held_out, seen = read_planes(folder, (3,))
    guess = InterfaceGuess(
        'interface', (1.0, 1.46, 1.33), (0.006,), deviations={'target_index': 0.001}
    )
    if start == 'published wall':
        guess = replace(guess, normal=tuple(wall.normal), distance=wall.distance)
    result = calibrate_interface(
        air, [View('planes 1, 2, 4', train, pixels)], [guess], free_cameras=True
    )
    assert result.adjustment is not None
    (pose,) = result.adjustment.poses
    error = triangulate(result.state.rig(), *seen).points - pose.apply(held_out)
    assert 1000.0 * np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.45  # 0.601 in SOURCE.md
