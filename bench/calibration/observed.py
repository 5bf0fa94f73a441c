"""Is an index "observed" that is not what it says? Rigs measured by hand, off by the defaults.

python bench/calibration/observed.py [--runs 100] [--pairs 50] [--only KIND]

Every run draws a rig whose surface or ports and baseline err by what the triangulator takes where
nothing is stated, and an index from its prior of +- 0.05; a target moves through both pictures at
0.1 px. The triangulator follows the index with its default options. Beside it the same rigs taken
for exact, which is what the defaults are for.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.rig_files import camera_infos_from_stereo
from binopos_ros.triangulation.options import (
    USUAL_BASELINE,
    IndexOptions,
    TriangulatorOptions,
)
from binopos_ros.triangulation.stage import Centroid, Position, Triangulator
from binopos_ros.triangulation.surface_options import (
    DOME,
    USUAL_CENTRE,
    USUAL_DISTANCE,
    USUAL_NORMAL,
    InterfaceOptions,
    PortOptions,
)
from figures import Column, Figures

CAMERA = PinholeCamera(
    [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]],
    [-0.1, 0.05, 0.001, -0.001, 0.01],
    (1280, 960),
)
BASELINE = np.array([-0.23, 0.0, 0.0])
NOISE, PRIOR = 0.1, 0.05  # px, index
FRAME = 33_333_333  # ns
FEW_SIGMA = 3.0
SURFACE = InterfaceOptions((0.03, 0.06, 1.0), 0.8, (1.0, 1.333))
WALL = InterfaceOptions((0.03, 0.06, 1.0), 0.6, (1.0, 1.49, 1.333), (0.012,))
PORT = PortOptions((0.0, 0.0, 1.0), 0.05, (1.0, 1.49, 1.333), (0.01,))
DOMED = PortOptions(
    shape=DOME, centre=(0.0, 0.0, 0.003), radius=0.05, indices=PORT.indices, thicknesses=(0.01,)
)
INDEX = IndexOptions(std=PRIOR)
RIGS = {
    'surface': TriangulatorOptions(interface=SURFACE, index=INDEX),
    'wall': TriangulatorOptions(interface=WALL, index=INDEX),
    'ports': TriangulatorOptions(left_port=PORT, right_port=PORT, index=INDEX),
    'domes': TriangulatorOptions(left_port=DOMED, right_port=DOMED, index=INDEX),
}
EXACT = {'normal_std': 0.0, 'distance_std': 0.0}


@dataclass(frozen=True)
class Outcome:
    """At the end of a run: whether the index is observed, and its error in its deviations."""

    observed: bool
    error: float


def off(surface: Interface | None, rng: np.random.Generator) -> Interface | None:
    """A surface that errs by the default deviations."""
    if isinstance(surface, DomePort):
        centre = surface.centre + USUAL_CENTRE * rng.standard_normal(3)
        return DomePort(centre, surface.radius, surface.thickness, surface.indices)
    if surface is None:
        return None
    assert isinstance(surface, FlatInterface)
    distance = surface.distance + USUAL_DISTANCE * rng.standard_normal()
    normal = surface.tilted(*(USUAL_NORMAL * rng.standard_normal(2)))
    return FlatInterface(normal, distance, surface.indices, surface.thicknesses)


def taken_for_exact(options: TriangulatorOptions) -> TriangulatorOptions:
    """The same, with nothing uncertain."""
    ports = {
        side: replace(getattr(options, side), **EXACT, centre_std=0.0)
        for side in ('left_port', 'right_port')
    }
    interface = replace(options.interface, **EXACT)
    return replace(options, interface=interface, baseline_std=0.0, **ports)


def run(kind: str, seed: int, pairs: int) -> dict[str, Outcome]:
    """One rig, with the defaults and taken for exact."""
    options, rng = RIGS[kind], np.random.default_rng([seed, len(kind)])
    baseline = BASELINE * (1.0 + USUAL_BASELINE * rng.standard_normal())
    surfaces = [off(surface, rng) for surface in options.interfaces()]
    rig = StereoRig(CAMERA, CAMERA, np.eye(3), baseline, *surfaces)  # type: ignore[arg-type]
    truth = 1.333 + PRIOR * rng.standard_normal()
    rig = rig.with_target_index(truth)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    t = np.arange(pairs) / 30.0
    waves = np.sin(2.0 * np.pi * np.outer(t, [0.31, 0.23, 0.17]) + phases)
    points = np.array([0.115, 0.0, 1.1]) + waves * [0.25, 0.18, 0.15]
    pixels = [p + NOISE * rng.standard_normal(p.shape) for p in rig.project(points)]
    ways = {'defaults': options, 'taken for exact': taken_for_exact(options)}
    return {name: follow(way, pixels, truth) for name, way in ways.items()}


def follow(options: TriangulatorOptions, pixels: list[np.ndarray], truth: float) -> Outcome:
    """What the triangulator says of the index at the end."""
    stage = Triangulator(options)
    infos = camera_infos_from_stereo(CAMERA, CAMERA, np.eye(3), BASELINE)
    for side, info in zip(('left', 'right'), infos, strict=True):
        stage.set_camera(side, info)
    last: Position | None = None
    covariance = NOISE**2 * np.eye(2)
    for i, both in enumerate(zip(*pixels, strict=True)):
        for side, pixel in zip(('left', 'right'), both, strict=True):
            centroid = Centroid(10**9 + i * FRAME, side, pixel, covariance, 30.0)
            for result in stage.add(side, centroid):
                last = result if isinstance(result, Position) else last
    if last is None:
        # So far off that left and right are not taken for the same target.
        return Outcome(False, np.nan)
    index = last.index
    assert index is not None
    return Outcome(index.observed, (index.mean - truth) / index.std)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=100)
    parser.add_argument('--pairs', type=int, default=50)
    parser.add_argument('--only', choices=RIGS)
    arguments = parser.parse_args()
    print(f'{arguments.runs} runs of {arguments.pairs} pairs, {NOISE} px, index 1.333 +- {PRIOR}')
    kept = Figures('calibration/observed', runs=arguments.runs, pairs=arguments.pairs)
    table = kept.table(
        'rigs',
        '',
        Column('the rig is'),
        Column('observed', '.0f'),
        Column('of these beyond 3 sigma', '.0f'),
        Column('mean square', '.2f'),
    )
    for kind in [arguments.only] if arguments.only else RIGS:
        found = [run(kind, seed, arguments.pairs) for seed in range(arguments.runs)]
        for way in found[0]:
            own = [one[way] for one in found]
            told = [one for one in own if one.observed]
            beyond = sum(abs(one.error) > FEW_SIGMA for one in told)
            square = np.nanmean([one.error**2 for one in own])
            table.row(kind, way, len(told), beyond, square)
    if arguments.only is None:
        kept.keep()


if __name__ == '__main__':
    main()
