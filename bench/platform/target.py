"""A target before a hovering robot: the pose beside the raw position and the optimal filter.

python bench/platform/target.py

RMS in the fixed frame, mm, of ten seconds at 30 Hz. `optimal` is the mean weighted by the true
covariances of a filter that is told that the target is at rest; `mean` the same by the covariances
that the platform states; `square` are normalised squared errors divided by three, and `+-` their
standard errors.

The error of a mean hardly changes in a run, so that each run tells little more than three numbers
of what it should be: a square needs many, and each row its own.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.append(str(Path(__file__).parents[2] / 'test' / 'scenes'))

from binopos_ros.simulation.rig_motion import Odometer
from figures import Column, Figures
from hovering import Outcome, hovering, rms

STILL, MOVING = 24, 6
ODOMETERS = {
    '0.1 degree, 2 mm': Odometer(0.002, float(np.deg2rad(0.1))),
    '0.02 degree, 0.5 mm': Odometer(0.0005, float(np.deg2rad(0.02))),
}


def main() -> None:
    """Print the table."""
    kept = Figures('platform/target')
    titles = (
        *('range, m', 'noise, px', 'raw', 'optimal', 'mean', 'square', 'pose', 'square', '+-'),
        *('pose / optimal', 'moving: raw', 'pose', 'square'),
    )
    columns = (Column(title, '.2f') for title in titles)
    table = kept.table('targets', 'odometry from sample to sample', *columns)
    seeds = iter(range(10**6))
    for name, odometer in ODOMETERS.items():
        for distance in (1.0, 2.0, 3.0):
            for pixels in (0.05, 0.3):
                still, moving = (
                    [
                        hovering(distance, pixels, odometer, next(seeds), moving)
                        for _ in range(count)
                    ]
                    for moving, count in ((False, STILL), (True, MOVING))
                )
                raw, optimal, own, pose = (
                    _all(still, each) for each in ('raw', 'optimal', 'own', 'pose')
                )
                table.row(
                    name,
                    *(distance, pixels, raw, optimal, own, _square(still, 'own')),
                    *(pose, _square(still, 'pose'), _doubt(still), pose / optimal),
                    *(_all(moving, 'raw'), _all(moving, 'pose'), _square(moving, 'pose')),
                )
    kept.keep()


def _all(runs: list[Outcome], name: str) -> float:
    """RMS over all runs, mm."""
    return 1e3 * rms(np.concatenate([getattr(run, name) for run in runs]))


def _square(runs: list[Outcome], name: str) -> float:
    return float(np.mean([getattr(run, f'{name}_square').mean() for run in runs]))


def _doubt(runs: list[Outcome]) -> float:
    """Standard error of the poses' normalised square."""
    return float(np.std([run.pose_square.mean() for run in runs]) / len(runs) ** 0.5)


if __name__ == '__main__':
    main()
