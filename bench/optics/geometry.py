"""How exact bent rays are: round trips, steps of the solver and derivatives, for every stack.

Run as `python bench/optics/geometry.py`. Per stack of layers, 105 rays of 0 to 85 degrees of
incidence (up to total reflection where that comes first), the surface leaning by half of that:

round trip   pixel -> bent ray -> point 1 m into the target's medium -> pixel, the largest change
steps        the most that the ray's equation took, and took on average, at 0 to 89 degrees in the
             lightest medium, with the camera 1 mm to 10 m before the surface and the target
             1 um to 100 m behind it
derivatives  analytic against central differences, relative to the largest, for the point, the
             target medium's index and the surface's parameters
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import numpy as np

import layer_stacks
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.arithmetic import ARRAYS
from binopos_ros.optics.stack import ParallelStack
from figures import Column, Figures

CAMERA = PinholeCamera([[800.0, 0, 640], [0, 800, 480], [0, 0, 1]], (), (1280, 960))
STEP = 1e-6


def round_trip(indices: tuple[float, ...], thicknesses: tuple[float, ...]) -> float:
    """Return the largest change of a pixel, px."""
    critical = np.arcsin(min(1.0, min(indices) / indices[0]))
    worst = 0.0
    for half in np.linspace(0.0, np.radians(85.0), 105) / 2:
        if 2 * half > critical:
            break
        normal = (np.sin(half), 0.0, np.cos(half))
        surface = FlatInterface(normal, 1.0, indices, thicknesses)
        rig = StereoRig(CAMERA, CAMERA, np.eye(3), (-0.23, 0, 0), surface)
        pixel = CAMERA.project((-np.sin(half), 0.0, np.cos(half)))
        (start, direction), _ = rig.back_project(pixel, pixel)
        worst = max(worst, np.abs(rig.project(start + direction)[0] - pixel).max())
    return worst


def steps(indices: tuple[float, ...], thicknesses: tuple[float, ...]) -> tuple[int, float]:
    """Return the most steps and the mean of them, ray by ray."""
    taken = []
    for distance in (1e-3, 0.02, 1.0, 10.0):
        stack = ParallelStack(indices, (distance, *thicknesses))
        for height in (1e-6, 1e-3, 0.1, 1.0, 100.0):
            for degrees in np.linspace(0.5, 89.0, 60):
                p = min(indices) * np.sin(np.radians(degrees))
                layers = np.array([distance, *thicknesses, height])
                radius = (layers * p / np.sqrt(np.square(indices) - p * p)).sum()
                asked = [0]

                def count(condition: bool, asked: list[int] = asked) -> bool:
                    asked[0] += 1
                    return bool(condition)

                counting = ARRAYS._replace(maximum=max, minimum=min, any=count)
                stack.slope(radius * radius, height, counting)
                taken.append(asked[0])
    return max(taken), float(np.mean(taken))


def derivatives(rig: StereoRig, points: np.ndarray) -> float:
    """Return the largest disagreement with central differences, relative."""
    found = rig.differentiate(points)
    pairs = []
    for axis, move in enumerate(STEP * np.eye(3)):
        ahead, behind = rig.project(points + move)[0], rig.project(points - move)[0]
        pairs.append((found.left_by_point[:, :, axis], ahead - behind))
    by_parameters = rig.parameter_jacobian(points)[0]
    for k, move in enumerate(STEP * np.eye(len(rig.parameter_names))):
        ahead, behind = (rig.perturbed(s * move).project(points)[0] for s in (1, -1))
        pairs.append((by_parameters[:, :, k], ahead - behind))
    errors = [
        np.abs(analytic - difference / (2 * STEP)).max() / max(np.abs(analytic).max(), 1.0)
        for analytic, difference in pairs
    ]
    return max(errors)


def main() -> None:
    """Print one line per stack."""
    points = np.random.default_rng(3).uniform([-0.5, -0.4, 1.15], [0.6, 0.4, 2.5], (105, 3))
    found = Figures('optics/geometry')
    table = found.table(
        'layers',
        'layers',
        Column('round trip, px', '.1e'),
        Column('steps, most', '.0f'),
        Column('steps, mean', '.3g'),
        Column('derivatives', '.1e'),
    )
    for name, rig in layer_stacks.RIGS.items():
        alone: tuple[float | None, ...] = (None, None, None)
        if name in layer_stacks.STACKS:
            layers = layer_stacks.STACKS[name]
            alone = round_trip(*layers), *steps(*layers)
        table.row(name, *alone, derivatives(rig, points))
    found.keep()


if __name__ == '__main__':
    main()
