"""How fast are bent rays: this project beside AquaCal and OpenCV, in one run.

Run as `python bench/optics/speed.py`; with `aquacal` installed in the same environment (pip
install aquacal) its columns are filled in, otherwise the table says so. The scene is the paper's:
two cameras with five distortion terms, 230 mm apart, 0.8 m above water. OpenCV's functions know no
refraction; they are here as the floor. Every figure is the best of several runs.
The last table is of two housings with a port each: flat ones, domes, and both before a wall.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.lens import EQUIDISTANT
from binopos_ros.triangulation import triangulate

INDEX = 1.333
SURFACE = 0.8  # m
MATRIX = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
TERMS = np.array([-0.1, 0.02, 1e-3, -5e-4, 0.0])
SIZE = (1280, 960)
SHIFT = np.array([-0.23, 0.0, 0.0])
COVARIANCE = 0.01 * np.eye(2)  # px^2
ROUNDS = 20


def seconds(work: Callable[[], Any], runs: int) -> float:
    """Return the shortest of several runs."""
    best = float('inf')
    for _ in range(runs):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best


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


def row(name: str, ours: float, peer: float | None, floor: float, count: int) -> None:
    """Print one line: points per second, and ratios."""
    known = f'{count / peer:>12,.0f} {peer / ours:>9.3g}x' if peer else f'{"-":>12} {"-":>10}'
    print(f'{name:<34}{count / ours:>14,.0f} {known} {count / floor:>14,.0f}')


def housings() -> None:
    """Print what a port each costs, by its shape: us per point, and per live pair."""
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
    best = {name: [float('inf')] * 3 for name, *_ in kinds}
    # By turns, so that whatever else the machine does falls on all alike.
    for _ in range(ROUNDS):
        for name, pair, surface, lens in kinds:
            rig = StereoRig(lens, lens, np.eye(3), SHIFT, surface, *pair)
            some = points[: 200 if surface else None]
            left, right = (pixels[0] for pixels in rig.project(points[:1]))
            took = (
                seconds(partial(rig.project, some), 3) / len(some),
                seconds(partial(rig.differentiate, some), 3) / len(some),
                seconds(partial(triangulate, rig, left, right, COVARIANCE, COVARIANCE), 40),
            )
            best[name] = [min(pair) for pair in zip(best[name], took, strict=True)]
    print(f'\n{"a port each":<24}{"project":>10}{"derivatives":>13}{"live pair":>11}   (us)')
    for name, (project, slopes, live) in best.items():
        print(f'{name:<24}{1e6 * project:>10.2f}{1e6 * slopes:>13.2f}{1e6 * live:>11.0f}')


def main() -> None:
    """Run everything and print the tables."""
    camera = PinholeCamera(MATRIX, TERMS, SIZE)
    surface = FlatInterface((0, 0, 1), SURFACE, (1.0, INDEX))
    rig = StereoRig(camera, camera, np.eye(3), SHIFT, surface)
    rng = np.random.default_rng(0)
    many = rng.uniform([-0.3, -0.3, 1.0], [0.5, 0.3, 1.5], (400_000, 3))
    few = many[:10_000]
    left, right = rig.project(many)
    left += 0.1 * rng.standard_normal(left.shape)
    aquacal = AquaCal() if importlib.util.find_spec('aquacal') else None
    if aquacal is None:
        print('aquacal is not installed: its column is left empty (pip install aquacal)\n')
    else:
        apart = np.abs(aquacal.project(few) - np.hstack(rig.project(few))).max()
        print(f'largest difference from AquaCal over {len(few):,} points: {apart:.1e} px\n')

    def straight() -> None:
        for shift in (np.zeros(3), SHIFT):
            cv2.projectPoints(few, np.zeros(3), shift, MATRIX, TERMS)

    print(f'{os.cpu_count()} cores; OpenCV without refraction')
    print(f'{"points per second":<34}{"binopos":>14} {"AquaCal":>12} {"ratio":>10} {"OpenCV":>14}')
    share = len(many) / len(few)
    peer = share * seconds(lambda: aquacal.project(few), 3) if aquacal else None
    floor = share * seconds(straight, 50)
    row('project, both cameras', seconds(lambda: rig.project(many), 7), peer, floor, len(many))
    row('project with derivatives', seconds(lambda: rig.differentiate(many), 5), peer, floor,
        len(many))  # fmt: skip

    def ours() -> None:
        triangulate(rig, left, right, COVARIANCE, COVARIANCE)

    peer = floor = 0.0
    if aquacal:
        peer = 200 * seconds(lambda: aquacal.triangulate(left[:2000], right[:2000]), 3)
    floor = seconds(lambda: opencv_triangulate(left, right), 3)
    row('triangulate, with covariance', seconds(ours, 5), peer or None, floor, len(many))

    def one_by_one(call: Callable[[np.ndarray, np.ndarray], Any], count: int = 40) -> float:
        def loop() -> None:
            for i in range(count):
                call(left[i : i + 1], right[i : i + 1])

        return seconds(loop, 60) / count

    live = one_by_one(lambda a, b: triangulate(rig, a[0], b[0], COVARIANCE, COVARIANCE))
    peer = one_by_one(aquacal.triangulate) if aquacal else 0.0
    floor = one_by_one(opencv_triangulate)
    row('triangulate, one pair at a time', live, peer or None, floor, 1)
    print(f'\none live triangulation with covariance: {1e6 * live:.0f} us')
    housings()


if __name__ == '__main__':
    main()
