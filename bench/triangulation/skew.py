"""Free-running cameras: what a skew does to a moving target, and what is left of it.

    python bench/triangulation/skew.py

The scenes of the tests, test/scenes/skewed_target.py: the paper's rig over water, 0.05 px,
200 pairs at 30 per second, the right image so many frame periods after the left one.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import numpy as np

import skewed_target

SKEWS = (-0.45, -0.2, 0.2, 0.45)


def main() -> None:
    def rms_and_square(name: str, skew: float, triggered: bool) -> tuple[float, float]:
        target = skewed_target.PATHS[name]
        stage = skewed_target.triangulator(triggered=triggered)
        errors, square = skewed_target.misses(
            skewed_target.positions(stage, skewed_target.seen(target, skew)), target
        )
        return 1e3 * float(np.sqrt((errors**2).sum(axis=1).mean())), square

    print('3-D RMS in mm, and mean normalised squared error (3 is right)\n')
    print('| target | skew, periods | same instant | as it is | | brought along | |')
    print('|---|---|---|---|---|---|---|')
    for name in skewed_target.PATHS:
        together, _ = rms_and_square(name, 0.0, False)
        for skew in SKEWS:
            before, square = rms_and_square(name, skew, True)
            after, honest = rms_and_square(name, skew, False)
            print(
                f'| {name.replace("_", " ")} | {skew} | {together:.2f} | {before:.2f} '
                f'| {square:.0f} | {after:.2f} | {honest:.2f} |'
            )


if __name__ == '__main__':
    main()
