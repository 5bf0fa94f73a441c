"""Time per step of the smoothers beside filterpy's predict and update.

python bench/smoothing/speed.py [FILTER ...] (all by default, and kept only then)
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import filterpy.kalman
import numpy as np

from binopos_ros.evaluation.trials.sequences import unseen_set
from binopos_ros.smoothing import FILTERS, make_filter
from figures import Column, Figures

ROUNDS = 5
PEER = 'filterpy predict + update'
WAVES, RIPPLES = 'cloud-kalman under waves', 'cloud-kalman under ripples'

Step = tuple[float, np.ndarray, np.ndarray] | tuple[float, np.ndarray, np.ndarray, np.ndarray]


def main() -> None:
    """Print the table, from rounds in turn, so that all filters meet the same machine."""
    found = Figures('smoothing/speed', peers=('filterpy',))
    trial = unseen_set(1)[0]
    steps = [
        (float(trial.stamps[number]), trial.positions[number], trial.covariances[number])
        for number in np.flatnonzero(np.isfinite(trial.positions[:, 0]))
    ]
    # As if the rays' miss had told of waves that double the deviation.
    waving = [(stamp, place, 4.0 * noise, 3.0 * noise) for stamp, place, noise in steps]
    # And of such as are between calm and rough, where two filters are blended.
    rippling = [(stamp, place, 2.5 * noise, 1.5 * noise) for stamp, place, noise in steps]
    runs: dict[str, tuple[Callable[[], Callable[..., object]], Sequence[Step]]] = {
        PEER: (filterpy_step, steps),
        WAVES: (lambda: make_filter('cloud-kalman').step, waving),
        RIPPLES: (lambda: make_filter('cloud-kalman').step, rippling),
        **{
            name: (lambda name=name: make_filter(name).step, steps)
            for name in sys.argv[1:] or FILTERS
        },
    }
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(ROUNDS):
        for name, (start, taken) in runs.items():
            seconds[name] += timed(start(), taken)
    # The lower quartile is a step that no other work on the machine got in the way of.
    typical = {name: float(np.percentile(taken, 25)) for name, taken in seconds.items()}
    table = found.table(
        'steps',
        'filter',
        Column('us a step', '.0f'),
        Column("times filterpy's, by lower quartiles", '.2f', '>'),
    )
    for name, value in typical.items():
        ours = name.startswith(('cloud-kalman', 'kalman', 'none'))
        table.row(name, 1e6 * np.array(seconds[name]), value / typical[PEER], compared=ours)
    if not sys.argv[1:]:
        found.keep()


def timed(step: Callable[..., object], steps: Sequence[Step]) -> list[float]:
    """Return the seconds that each step takes: checks, prediction, update, state, covariance."""
    taken = []
    for measured in steps:
        began = time.perf_counter()
        step(*measured)
        taken.append(time.perf_counter() - began)
    return taken


def filterpy_step() -> Callable[[float, np.ndarray, np.ndarray], object]:
    """Return filterpy's constant-velocity filter; its matrices change, as stamps are uneven."""
    kalman = filterpy.kalman.KalmanFilter(dim_x=6, dim_z=3)
    kalman.H = np.hstack([np.eye(3), np.zeros((3, 3))])
    psi, noise, eye = np.eye(6), np.empty((6, 6)), np.eye(3)
    before = [0.0]

    def step(stamp: float, position: np.ndarray, covariance: np.ndarray) -> None:
        elapsed, before[0] = stamp - before[0], stamp
        psi[:3, 3:] = elapsed * eye
        noise[:3, :3] = 1e-3 * elapsed**3 / 3.0 * eye
        noise[:3, 3:] = noise[3:, :3] = 1e-3 * elapsed**2 / 2.0 * eye
        noise[3:, 3:] = 1e-3 * elapsed * eye
        kalman.predict(F=psi, Q=noise)
        kalman.update(position, R=covariance)

    return step


if __name__ == '__main__':
    main()
