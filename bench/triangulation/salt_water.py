"""The paper's salt water experiment (Sec. 5.3), in simulation with known truth.

A washbowl: cameras 230 mm apart look down on the surface 0.8 m below, the target lies on the floor
under 0.49 m of water. Salt is added without stirring: in each of 100 experiments the water has
another mean index, 1.33 to 1.38, and a gradient (50 layers), and the target lies elsewhere. An
experiment is 300 pairs (10 s at 30 Hz) of 0.1 px of noise.

    python bench/triangulation/salt_water.py
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.column import mean_index
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.evidence import gather_evidence
from binopos_ros.triangulation.index import IndexEstimator
from binopos_ros.triangulation.paper import frame_index, triangulate_paper
from figures import Column, Figures, Table

EXPERIMENTS, PAIRS, RATE = 100, 300, 30.0
PIXEL_STD = 0.1
COVARIANCE = PIXEL_STD**2 * np.eye(2)
SURFACE, DEPTH, LAYERS = 0.8, 0.49, 50
FRESH, BRINE = 1.33, 1.38
PRIOR_MEAN, PRIOR_STD = (FRESH + BRINE) / 2, (BRINE - FRESH) / np.sqrt(12)
FLOOR_STD = 1e-3
CAMERA = PinholeCamera([[900, 0, 639.5], [0, 900, 479.5], [0, 0, 1]], [], (1280, 960))


class Experiment(NamedTuple):
    """One state of the water, one place of the target, and the pixels (PAIRS, 4) of it."""

    index: float
    target: np.ndarray
    exact: np.ndarray
    pixels: np.ndarray


def washbowl(indices: np.ndarray, thicknesses: np.ndarray | tuple = ()) -> StereoRig:
    surface = FlatInterface((0, 0, 1), SURFACE, (1.0, *indices), thicknesses)
    return StereoRig(CAMERA, CAMERA, np.eye(3), (-0.23, 0, 0), surface)


def salted(mean: float, random: np.random.Generator) -> np.ndarray:
    """Indices (LAYERS,) from the surface down, of this mean, saltiest at the floor."""
    height = (np.arange(LAYERS) + 0.5) / LAYERS
    shape = np.exp((height - 1.0) / random.uniform(0.1, 1.0))
    shape -= shape.mean()
    steepest = min((BRINE - mean) / shape.max(), (FRESH - mean) / shape.min())
    return mean + random.uniform(0.0, steepest) * shape


def place(random: np.random.Generator) -> np.ndarray:
    """A point of the floor that both cameras see."""
    rig = washbowl(np.array([PRIOR_MEAN]))
    while True:
        point = np.array([*random.uniform((-0.8, -0.7), (1.0, 0.7)), SURFACE + DEPTH])
        pixels = np.concatenate(rig.project(point)).reshape(2, 2)
        if ((pixels > 20) & (pixels < (1260, 940))).all():
            return point


def experiments(random: np.random.Generator) -> list[Experiment]:
    """In the order in which salt is added: the mean index rises."""
    done = []
    for mean in np.sort(random.uniform(FRESH, BRINE, EXPERIMENTS)):
        target, indices = place(random), salted(mean, random)
        thicknesses = np.full(LAYERS, DEPTH / LAYERS)
        exact = np.concatenate(washbowl(indices, thicknesses[1:]).project(target))
        noise = PIXEL_STD * random.standard_normal((PAIRS, 4))
        index = mean_index(indices.tolist(), thicknesses.tolist())
        done.append(Experiment(index, target, exact, exact + noise))
    return done


def located(experiment: Experiment, index: float) -> np.ndarray:
    """Error (3,) of the position from all pairs, m, with this index."""
    rig, pixels = washbowl(np.array([index])), experiment.pixels.mean(axis=0)
    return triangulate(rig, pixels[:2], pixels[2:]).points - experiment.target


def located_by_paper(experiment: Experiment, index: float) -> np.ndarray:
    rig, pixels = washbowl(np.array([index])), experiment.pixels.mean(axis=0)
    return triangulate_paper(rig, pixels[:2], pixels[2:])[0][0] - experiment.target


def estimated(
    done: list[Experiment], *, keep: bool, floor_errors: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, int]:
    """Index (E,) and its deviation (E,) at the end of each experiment; how often observed.

    Args:
        done: the experiments.
        keep: one estimator for all of them, a minute apart, against a new one for each.
        floor_errors: (E,) m, of the floor's depth where it is given to the estimator.
    """
    rig = washbowl(np.array([PRIOR_MEAN]))
    means, stds, observed = [], [], 0
    estimator = IndexEstimator(PRIOR_MEAN, PRIOR_STD, drift=2e-4)
    for number, experiment in enumerate(done):
        if not keep:
            plane = None
            if floor_errors is not None:
                plane = KnownPlane((0, 0, 1), SURFACE + DEPTH + floor_errors[number], FLOOR_STD)
            estimator = IndexEstimator(PRIOR_MEAN, PRIOR_STD, known_plane=plane)
        for k, row in enumerate(experiment.pixels):
            stamp = 60.0 * number + k / RATE
            state = estimator.update(rig, row[:2], row[2:], COVARIANCE, COVARIANCE, stamp)
        means.append(state.mean)
        stds.append(state.std)
        observed += state.observed
    return np.array(means), np.array(stds), observed


def row(
    table: Table, name: str, errors: np.ndarray, base: float, index: str | None = None
) -> None:
    millimetres = 1e3 * errors
    rms = np.sqrt(np.mean(np.sum(millimetres**2, axis=1)))
    axes = np.sqrt(np.mean(millimetres**2, axis=0))
    table.row(name, rms, *axes, np.abs(millimetres).max(), 100 * (rms / base - 1), index)


def main() -> None:
    random = np.random.default_rng(53)
    done = experiments(random)
    truth = np.array([experiment.index for experiment in done])
    alone = estimated(done, keep=False)
    together = estimated(done, keep=True)
    floor_errors = random.normal(0.0, FLOOR_STD, EXPERIMENTS)
    held = estimated(done, keep=False, floor_errors=floor_errors)

    def errors(indices: np.ndarray) -> np.ndarray:
        return np.array([located(e, n) for e, n in zip(done, indices, strict=True)])

    def about(result: tuple[np.ndarray, np.ndarray, int]) -> str:
        means, stds, observed = result
        error = means - truth
        return (
            f'{np.sqrt(np.mean(error**2)):.4f} (stated {np.sqrt(np.mean(stds**2)):.4f}, '
            f'chi-square {np.mean((error / stds) ** 2):.2f}, observed {observed})'
        )

    base = errors(together[0])
    size = 1e3 * np.sqrt(np.mean(np.sum(base**2, axis=1)))
    print(f'{EXPERIMENTS} experiments of {PAIRS} pairs, {PIXEL_STD} px, errors in mm')
    kept = Figures('triangulation/salt_water')
    table = kept.table(
        'experiments',
        'index; errors in mm',
        *(Column(title, '.2f') for title in ('3-D RMS', 'x', 'y', 'z')),
        Column('largest', '.1f'),
        Column('against estimated, %', '+.0f'),
        Column('RMS error of the index'),
    )
    row(table, 'true mean', errors(truth), size)
    row(table, 'estimated, kept from experiment to experiment', base, size, about(together))
    row(table, 'estimated, anew in each experiment', errors(alone[0]), size, about(alone))
    row(table, 'estimated anew, floor known to 1 mm', errors(held[0]), size, about(held))
    row(table, 'middle of the prior, 1.355', errors(np.full(EXPERIMENTS, PRIOR_MEAN)), size)
    row(table, '1.33 assumed', errors(np.full(EXPERIMENTS, FRESH)), size)
    by_paper = np.array([located_by_paper(experiment, FRESH) for experiment in done])
    row(table, "1.33 assumed, the paper's method", by_paper, size)
    kept.keep()

    single = [
        triangulate(washbowl(np.array([e.index])), e.pixels[0, :2], e.pixels[0, 2:]).points
        - e.target
        for e in done
    ]
    scatter = 1e3 * np.sqrt(np.mean(np.sum(np.square(single), axis=1)))
    print(f'\nOne pair at the true mean: {scatter:.2f} mm 3-D RMS.')
    rig = washbowl(np.array([PRIOR_MEAN]))
    exact = np.array([e.exact for e in done])
    averaged = np.array([e.pixels.mean(axis=0) for e in done])
    stds = 1.0 / np.array(
        [gather_evidence(rig, z[:2], z[2:], COVARIANCE, COVARIANCE).clue.gain for z in exact]
    )
    seen = stds < 1.0
    low, middle, high = np.percentile(stds, (10, 50, 90))
    print(
        f'One pair tells the index to {low:.3f} / {middle:.3f} / {high:.3f} (10 / 50 / 90 % of '
        f'places); {np.sum(~seen)} places do not tell it.'
    )
    needed, _ = frame_index(rig, exact[:, :2], exact[:, 2:])
    bias = (needed - truth)[seen]
    print(
        'Index that a single layer needs for the same images, without noise, less the true mean: '
        f'median {np.median(bias):+.5f}, largest {np.nanmax(np.abs(bias)):.5f}.'
    )
    found, _ = frame_index(rig, averaged[:, :2], averaged[:, 2:])
    print(
        f"The paper's mean refractive index of each experiment, from {PAIRS} pairs averaged, lies "
        f'in {FRESH} to {BRINE} in {np.sum((found > FRESH) & (found < BRINE))} of {EXPERIMENTS}.'
    )


if __name__ == '__main__':
    main()
