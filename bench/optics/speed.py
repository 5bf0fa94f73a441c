"""How fast are bent rays: this project beside AquaCal and OpenCV, in one run.

Run as `python bench/optics/speed.py`; with `aquacal` installed in the same environment (pip
install aquacal) its columns are filled in, otherwise the table says so. The scene is the paper's:
two cameras with five distortion terms, 230 mm apart, 0.8 m above water. OpenCV's functions know no
refraction; they are here as the floor. The last table is of two housings with a port each: flat
ones, domes, and both before a wall. Kept as `bench/results/optics/speed.json`.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
import numpy as np

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.lens import EQUIDISTANT
from binopos_ros.triangulation import triangulate
from figures import Column, Figures, Table

INDEX = 1.333
SURFACE = 0.8  # m
MATRIX = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
TERMS = np.array([-0.1, 0.02, 1e-3, -5e-4, 0.0])
SIZE = (1280, 960)
SHIFT = np.array([-0.23, 0.0, 0.0])
COVARIANCE = 0.01 * np.eye(2)  # px^2
ROUNDS, SOME, SINGLE = 12, 300, 400

Work = Callable[[], Any]
Works = dict[str, tuple[Work, int]]


def seconds(work: Callable[[], Any], runs: int, count: int = 1) -> np.ndarray:
    """Return what each of several runs took, per point of `count`."""
    taken = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        taken.append((time.perf_counter() - start) / count)
    return np.array(taken)


class AquaCal:
    """The peer, on the same scene."""

    def __init__(self) -> None:
        from aquacal.config.schema import CameraExtrinsics, CameraIntrinsics
        from aquacal.core.camera import Camera
        from aquacal.core.interface_model import Interface
        from aquacal.core.refractive_geometry import refractive_project_batch
        from aquacal.triangulation.triangulate import triangulate_point

        up = np.array([0.0, 0.0, -1.0])
        intrinsics = CameraIntrinsics(K=MATRIX, dist_coeffs=TERMS, image_size=SIZE)
        self.cameras = {}
        for name, shift in (('left', np.zeros(3)), ('right', SHIFT)):
            extrinsics = CameraExtrinsics(R=np.eye(3), t=shift)
            self.cameras[name] = Camera(name, intrinsics, extrinsics)
        surface = dict.fromkeys(self.cameras, SURFACE)
        self.interface = Interface(up, surface, n_air=1.0, n_water=INDEX)
        calibrations = {
            name: SimpleNamespace(
                intrinsics=camera.intrinsics, extrinsics=camera.extrinsics, water_z=SURFACE
            )
            for name, camera in self.cameras.items()
        }
        media = SimpleNamespace(normal=up, n_air=1.0, n_water=INDEX)
        self.calibration = SimpleNamespace(cameras=calibrations, interface=media)
        self._project, self._triangulate = refractive_project_batch, triangulate_point

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project into both cameras, (N, 4)."""
        cameras = self.cameras.values()
        return np.hstack([self._project(c, self.interface, points) for c in cameras])

    def triangulate(self, left: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Triangulate pair by pair, (N, 3); it has no batch and no covariance."""
        pairs = zip(left, right, strict=True)
        return np.array(
            [self._triangulate(self.calibration, {'left': a, 'right': b}) for a, b in pairs]
        )


def opencv_triangulate(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Undistort and triangulate straight, (N, 3)."""
    first = cv2.undistortPoints(left.reshape(-1, 1, 2), MATRIX, TERMS).reshape(-1, 2).T
    second = cv2.undistortPoints(right.reshape(-1, 1, 2), MATRIX, TERMS).reshape(-1, 2).T
    here, there = np.eye(3, 4), np.column_stack([np.eye(3), SHIFT])
    homogeneous = cv2.triangulatePoints(here, there, first, second)
    return (homogeneous[:3] / homogeneous[3]).T


def add(table: Table, name: str, rounds: int, works: Works) -> None:
    """Add a row: points per second, and how many times the others' that is.

    All take turns, and ratios are those of one turn: whatever else the machine does falls on all.
    """
    rates: dict[str, list[float]] = {key: [] for key in works}
    for _ in range(rounds):
        for key, (work, count) in works.items():
            rates[key].extend(1 / seconds(work, 1, count))
    ours, floor = np.array(rates['ours']), np.array(rates['OpenCV'])
    known: tuple[Any, Any] = (None, None)
    if 'AquaCal' in rates:
        known = rates['AquaCal'], ours / rates['AquaCal']
    table.row(name, ours, *known, floor, ours / floor)


def housings(found: Figures) -> None:
    """Add what a port each costs, by its shape: us per point, and per live pair."""
    glass = (1.0, 1.49, INDEX)
    flat = [FlatInterface((x, 0.01, 1.0), 0.035, glass, (0.008,)) for x in (0.02, -0.01)]
    domes = [DomePort((x, -0.001, 0.004), 0.05, 0.005, glass) for x in (0.002, -0.001)]
    wall = FlatInterface((0.05, 0.02, 1.0), 0.5, (INDEX, 1.49, 1.0), (0.02,))
    brown, wide = PinholeCamera(MATRIX, TERMS, SIZE), PinholeCamera(MATRIX, (), SIZE, EQUIDISTANT)
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 0.7], [0.5, 0.3, 1.5], (4000, 3))
    kinds: tuple[tuple[str, Sequence[Interface], FlatInterface | None, PinholeCamera], ...] = (
        ('flat', flat, None, brown),
        ('domes', domes, None, brown),
        ('domes, wide lenses', domes, None, wide),
        ('flat before a wall', flat, wall, brown),
        ('domes before a wall', domes, wall, brown),
    )
    taken: dict[str, list[list[float]]] = {name: [[], [], []] for name, *_ in kinds}
    # By turns, so that whatever else the machine does falls on all alike.
    for _ in range(ROUNDS):
        for name, pair, surface, lens in kinds:
            rig = StereoRig(lens, lens, np.eye(3), SHIFT, surface, *pair)
            some = points[: 200 if surface else None]
            left, right = (pixels[0] for pixels in rig.project(points[:1]))
            took = (
                seconds(partial(rig.project, some), 3, len(some)),
                seconds(partial(rig.differentiate, some), 3, len(some)),
                seconds(partial(triangulate, rig, left, right, COVARIANCE, COVARIANCE), 40),
            )
            for kept, each in zip(taken[name], took, strict=True):
                kept.extend(1e6 * each)
    table = found.table(
        'ports',
        'a port each',
        Column('project, us a point', '.2f'),
        Column('derivatives, us a point', '.2f'),
        Column('live pair, us', '.0f'),
    )
    for name, columns in taken.items():
        table.row(name, *columns)


def main() -> None:
    """Run everything and print the tables."""
    found = Figures('optics/speed', peers=('aquacal',))
    camera = PinholeCamera(MATRIX, TERMS, SIZE)
    surface = FlatInterface((0, 0, 1), SURFACE, (1.0, INDEX))
    rig = StereoRig(camera, camera, np.eye(3), SHIFT, surface)
    rng = np.random.default_rng(0)
    many = rng.uniform([-0.3, -0.3, 1.0], [0.5, 0.3, 1.5], (100_000, 3))
    few = many[:2_000]
    left, right = rig.project(many)
    left += 0.1 * rng.standard_normal(left.shape)
    aquacal = AquaCal() if importlib.util.find_spec('aquacal') else None
    if aquacal is None:
        print('aquacal is not installed: its column is left empty (pip install aquacal)')
    else:
        apart = np.abs(aquacal.project(few) - np.hstack(rig.project(few))).max()
        print(f'largest difference from AquaCal over {len(few):,} points: {apart:.1e} px')

    def straight() -> None:
        for shift in (np.zeros(3), SHIFT):
            cv2.projectPoints(many, np.zeros(3), shift, MATRIX, TERMS)

    table = found.table(
        'points',
        'points per second',
        Column('binopos_ros', ',.0f'),
        Column('AquaCal', ',.0f'),
        Column("times AquaCal's", '.3g', '<'),
        Column('OpenCV, straight rays', ',.0f'),
        Column("times OpenCV's", '.2g', '<'),
    )

    def works(ours: Work, theirs: Work, floor: Work, counts: Sequence[int]) -> Works:
        peer = {'AquaCal': (theirs, counts[1])} if aquacal else {}
        return {'ours': (ours, counts[0]), **peer, 'OpenCV': (floor, counts[2])}

    def singly(call: Callable[[np.ndarray, np.ndarray], Any]) -> Work:
        def loop() -> None:
            for i in range(SINGLE):
                call(left[i : i + 1], right[i : i + 1])

        return loop

    def peer_project() -> None:
        aquacal.project(few)

    def peer_triangulate() -> None:
        aquacal.triangulate(left[:SOME], right[:SOME])

    def one(a: np.ndarray, b: np.ndarray) -> None:
        triangulate(rig, a[0], b[0], COVARIANCE, COVARIANCE)

    size = len(many), len(few), len(many)
    for name, ours in (
        ('project, both cameras', lambda: rig.project(many)),
        ('project with derivatives', lambda: rig.differentiate(many)),
    ):
        add(table, name, ROUNDS, works(ours, peer_project, straight, size))
    every = works(
        lambda: triangulate(rig, left, right, COVARIANCE, COVARIANCE),
        peer_triangulate,
        lambda: opencv_triangulate(left, right),
        (len(many), SOME, len(many)),
    )
    add(table, 'triangulate, with covariance', ROUNDS, every)
    alone = works(
        singly(one),
        singly(aquacal.triangulate) if aquacal else one,
        singly(opencv_triangulate),
        (SINGLE,) * 3,
    )
    add(table, 'triangulate, one pair at a time', 2 * ROUNDS, alone)
    housings(found)
    found.keep()


if __name__ == '__main__':
    main()
