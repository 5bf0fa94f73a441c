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

sys.path.append(str(Path(__file__).parents[2] / 'test' / 'scenes'))

from binopos_ros.simulation.rig_motion import Odometer
from hovering import Outcome, hovering, rms

STILL, MOVING = 24, 6
ODOMETERS = {
    '0.1 degree, 2 mm': Odometer(0.002, float(np.deg2rad(0.1))),
    '0.02 degree, 0.5 mm': Odometer(0.0005, float(np.deg2rad(0.02))),
}


def main() -> None:
    """Print the table."""
    print(
        f'{"odometry":<20}{"m":>4}{"px":>6}{"raw":>8}{"optimal":>9}{"mean":>8}{"square":>8}'
        f'{"pose":>8}{"square":>8}{"+-":>6}{"of opt.":>9}'
        f'{"moving: raw":>13}{"pose":>8}{"square":>8}'
    )
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
                print(
                    f'{name:<20}{distance:>4.0f}{pixels:>6.2f}{raw:>8.2f}{optimal:>9.2f}'
                    f'{own:>8.2f}{_square(still, "own"):>8.2f}{pose:>8.2f}'
                    f'{_square(still, "pose"):>8.2f}{_doubt(still):>6.2f}{pose / optimal:>9.2f}'
                    f'{_all(moving, "raw"):>13.2f}{_all(moving, "pose"):>8.2f}'
                    f'{_square(moving, "pose"):>8.2f}',
                    flush=True,
                )


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
