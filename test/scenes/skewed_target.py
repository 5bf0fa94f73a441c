"""A target on its way, seen by two cameras that expose at different times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from binopos_ros.optics import CameraInfo, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Position, Triangulator

PERIOD = 1 / 30  # s
NOISE = 0.05  # px
BASELINE, FOCAL, INDEX = 0.23, 900.0, 1.333
NORMAL, DISTANCE = [0.05, 0.02, 1.0], 0.8
K = (FOCAL, 0, 640.0, 0, FOCAL, 480.0, 0, 0, 1.0)
CAMERA = PinholeCamera(np.reshape(K, (3, 3)), np.zeros(5), (1280, 960))
WATER = StereoRig(
    CAMERA, CAMERA, np.eye(3), [-BASELINE, 0, 0], FlatInterface(NORMAL, DISTANCE, (1.0, INDEX))
)
Path = Callable[[float], np.ndarray]
Arrival = tuple[str, Centroid]


def still(_: float) -> np.ndarray:
    return np.array([0.35, 0.1, 1.2])


def straight(t: float) -> np.ndarray:
    """0.1 m/s along the baseline."""
    return np.array([-0.3 + 0.1 * t, 0.1, 1.2])


def circle(t: float) -> np.ndarray:
    """0.24 m/s and 0.37 m/s^2 in 4 s."""
    phase = 2 * np.pi * t / 4
    return np.array([0.3 + 0.15 * np.cos(phase), 0.15 * np.sin(phase), 1.2 + 0.05 * np.sin(phase)])


def fast_circle(t: float) -> np.ndarray:
    """0.94 m/s and 5.9 m/s^2 in 1 s."""
    return circle(4 * t)


PATHS = {path.__name__: path for path in (still, straight, circle, fast_circle)}


def triangulator(**values: object) -> Triangulator:
    parameters = {
        'interface.normal': NORMAL,
        'interface.distance': DISTANCE,
        'interface.indices': [1.0, INDEX],
        'interface.normal_std': 0.0,
        'interface.distance_std': 0.0,
        'baseline_std': 0.0,
        'epipolar_gate': 0.0,
        'pair_tolerance': PERIOD / 2,
        # The water is, and what is looked at is the cameras' noise.
        'medium': 'still',
        **values,
    }
    stage = Triangulator(build(TriangulatorOptions, parameters))
    for side, shift in (('left', 0.0), ('right', -BASELINE * FOCAL)):
        p = (FOCAL, 0, 640.0, shift, 0, FOCAL, 480.0, 0, 0, 0, 1.0, 0)
        stage.set_camera(side, CameraInfo(side, 1280, 960, 'plumb_bob', (0.0,) * 5, K, p=p))
    return stage


def seen(path: Path, skew: float, pairs: int = 200, seed: int = 1) -> list[Arrival]:
    """What both cameras see, the right one `skew` frame periods after the left one."""
    random = np.random.default_rng(seed)
    arrivals = []
    for k in range(pairs):
        for i, (side, late) in enumerate((('left', 0.0), ('right', skew))):
            t = (k + late) * PERIOD
            pixel = WATER.project(path(t))[i] + random.normal(0, NOISE, 2)
            stamp = 10**18 + round(1e9 * t)
            arrivals.append((side, Centroid(stamp, side, pixel, NOISE**2 * np.eye(2), 40.0)))
    return sorted(arrivals, key=lambda arrival: arrival[1].stamp)


def positions(stage: Triangulator, arrivals: list[Arrival]) -> list[Position]:
    found = [result for arrival in arrivals for result in stage.add(*arrival)]
    return sorted((r for r in found if isinstance(r, Position)), key=lambda r: r.stamp)


def misses(found: list[Position], path: Path) -> tuple[np.ndarray, float]:
    """Errors (N, 3) m and the mean normalised squared one, once the target is followed."""
    later = found[3:]
    errors = np.array([p.point - path((p.stamp - 10**18) * 1e-9) for p in later])
    squares = [e @ np.linalg.solve(p.covariance, e) for e, p in zip(errors, later, strict=True)]
    return errors, float(np.mean(squares))
