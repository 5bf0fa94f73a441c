"""Free-running cameras: what a skew does to a moving target, and what is left of it.

    python bench/triangulation/skew.py

The scenes of the tests, test/scenes/skewed_target.py: the paper's rig over water, 0.05 px,
200 pairs at 30 per second, the right image so many frame periods after the left one.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import numpy as np

import skewed_target
from figures import Column, Figures

SKEWS = (-0.45, -0.2, 0.2, 0.45)


def main() -> None:
    def rms_and_square(name: str, skew: float, triggered: bool) -> tuple[float, float]:
        target = skewed_target.PATHS[name]
        stage = skewed_target.triangulator(triggered=triggered)
        errors, square = skewed_target.misses(
            skewed_target.positions(stage, skewed_target.seen(target, skew)), target
        )
        return 1e3 * float(np.sqrt((errors**2).sum(axis=1).mean())), square

    found = Figures('triangulation/skew')
    table = found.table(
        'targets',
        'target',
        Column('skew, periods', '.2g'),
        Column('same instant', '.2f'),
        Column('as it is', '.2f'),
        Column('NSE', '.0f'),
        Column('brought along', '.2f'),
        Column('NSE', '.2f'),
    )
    for name in skewed_target.PATHS:
        together, _ = rms_and_square(name, 0.0, False)
        for skew in SKEWS:
            before, square = rms_and_square(name, skew, True)
            after, honest = rms_and_square(name, skew, False)
            cells = skew, together, before, square, after, honest
            table.row(name.replace('_', ' '), *cells)
    found.keep()


if __name__ == '__main__':
    main()
