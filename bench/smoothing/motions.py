"""What the default filter makes of motions and waters that it was not designed on.

python bench/smoothing/motions.py [TABLE ...] [--seeds N] prints these tables, seeded (all by
default):

ports: each motion of `evaluation/trials/motions.py` at 10, 30 and 100 Hz, with 0.01, 0.1
   and 1 px of noise, 0.2, 1 and 10 m ahead. Pixels are triangulated by the triangulator; the
   filter runs over all sequences in lock-step, and alone, as the node runs it, over those that
   come out above 1.05: lock-step cannot start afresh.
faults: the same at 30 Hz, 0.1 px and 1 m, where the detector has faults; as the node runs it.
opponents: every filter behind ports, at 30 Hz, 0.1 px and 1 m, in lock-step.
calm: each motion under a free surface in calm water, at the same rates, noises and distances,
   half of them in the air; through `Tracker`.
waters: under a free surface, each water of `evaluation/trials/waters.py`, through `Tracker`.
calibration: a rig with its calibration's covariance, drawn 200 times, through `Tracker`.

ratio: RMS error of the poses, in that of the positions; the first second is left out. squares:
mean squared error by the poses' own covariance, per dimension; 1 if honest. inside: share of the
errors inside the stated 95 % region.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np

from binopos_ros.evaluation.trials.calibrated import drawn_squares
from binopos_ros.evaluation.trials.motions import (
    GENTLE,
    MOTIONS,
    Conditions,
    Score,
    draw_views,
    measure,
    ports_rig,
    score,
    surface_rig,
    track,
)
from binopos_ros.evaluation.trials.paths import KINDS
from binopos_ros.evaluation.trials.score import run, run_together
from binopos_ros.evaluation.trials.waters import WATERS, draw_water
from binopos_ros.smoothing import FILTERS, make_filter
from figures import Column, Figures, Table

RATES, PIXEL_STDS, DISTANCES = (10.0, 30.0, 100.0), (0.01, 0.1, 1.0), (0.2, 1.0, 10.0)
#: The goal: no pose is worse than its positions by more.
WORST = 1.05
FAULTS = {
    'none': Conditions(),
    'noise alike from frame to frame (0.9)': Conditions(likeness=0.9),
    'single wrong objects, 5 %': Conditions(wrong_share=0.05, burst=1),
    'bursts of 5 frames of a wrong object, 5 %': Conditions(wrong_share=0.05),
    '30 % detected': Conditions(detected_share=0.3),
    'variance stated 3 times too small': Conditions(stated=1.0 / 3.0),
    'variance stated 3 times too large': Conditions(stated=3.0),
}
#: Of the default filter, where they are not its own.
OPTIONS: dict[str, float] = {}
HEADER = (
    Column('ratio: median', '.2f'),
    Column('largest', '.2f'),
    Column('above 1.05'),
    Column('squares', '.2f'),
    Column('inside, %', '.0f'),
)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=6, help='sequences under each condition')
    parser.add_argument('tables', nargs='*', default=list(TABLES), help='names; default: all')
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE', help="the filter's options"
    )
    arguments = parser.parse_args()
    for setting in arguments.set:
        name, value = setting.split('=')
        OPTIONS[name] = float(value)
    for name in arguments.tables:
        kept = Figures(
            f'smoothing/motions.{name}', seeds=arguments.seeds, options=', '.join(arguments.set)
        )
        TABLES[name](kept, range(arguments.seeds))
        kept.keep()


def ports_tables(kept: Figures, seeds: range) -> None:
    """Motions behind ports: by motion, and by noise and distance."""
    rig = ports_rig()
    grid = [
        Conditions(rate, noise, distance)
        for rate, noise, distance in itertools.product(RATES, PIXEL_STDS, DISTANCES)
    ]
    scores: dict[tuple[str, Conditions], list[Score]] = {}
    for kind in MOTIONS:
        cases = list(itertools.product(grid, seeds))
        views = [draw_views(kind, rig, conditions, seed) for conditions, seed in cases]
        smoother = make_filter('cloud-kalman', **OPTIONS)
        trials = measure(rig, views)
        tracks = run_together(smoother, trials)
        for (conditions, _), seen, trial, tracked in zip(
            cases, views, trials, tracks, strict=True
        ):
            found = score(seen, trial, tracked)
            if not found.ratio <= WORST:
                found = score(seen, trial, run(smoother, trial))
            scores.setdefault((kind, conditions), []).append(found)
    table = kept.table('motions', 'motion', *HEADER)
    for kind in MOTIONS:
        row(
            table,
            kind,
            [each for key, found in scores.items() if key[0] == kind for each in found],
        )
    row(table, 'all', [each for found in scores.values() for each in found])
    gentle = [
        each.ratio
        for (kind, conditions), found in scores.items()
        for each in found
        if kind in GENTLE and conditions.pixel_std >= 0.05
    ]
    print(f'\nmedian ratio of {", ".join(GENTLE)} at 0.1 px and more: {np.median(gentle):.2f}')
    table = kept.table('distances', 'distance, noise', *HEADER)
    for distance, noise in itertools.product(DISTANCES, PIXEL_STDS):
        row(
            table,
            f'{distance:g} m, {noise:g} px',
            [
                each
                for (_, conditions), found in scores.items()
                for each in found
                if (conditions.distance, conditions.pixel_std) == (distance, noise)
            ],
        )
    worst = [
        (found.ratio, kind, conditions)
        for (kind, conditions), some in scores.items()
        for found in some
        if not found.ratio <= WORST
    ]
    for ratio, kind, at in sorted(worst, key=lambda each: -each[0]):
        print(
            f'above {WORST}: {ratio:.2f}, {kind} at {at.rate:g} Hz, {at.pixel_std:g} px, '
            f'{at.distance:g} m'
        )


def faults_table(kept: Figures, seeds: range) -> None:
    """Motions behind ports, seen by a detector with faults."""
    rig = ports_rig()
    table = kept.table('faults', 'fault', *HEADER)
    for name, conditions in FAULTS.items():
        cases = itertools.product(MOTIONS, seeds)
        views = [draw_views(kind, rig, conditions, seed) for kind, seed in cases]
        smoother = make_filter('cloud-kalman', **OPTIONS)
        row(
            table,
            name,
            [
                score(seen, trial, run(smoother, trial))
                for seen, trial in zip(views, measure(rig, views), strict=True)
            ],
        )


def opponents_table(kept: Figures, seeds: range) -> None:
    """Every filter behind ports, with the values that it was tuned to in a basin."""
    rig = ports_rig()
    kinds = ('still', 'hovering', 'swinging rig')
    columns = (Column(kind, '.2f') for kind in kinds)
    table = kept.table('filters', 'filter, median ratio', *columns)
    views = {kind: [draw_views(kind, rig, Conditions(), seed) for seed in seeds] for kind in kinds}
    trials = {kind: measure(rig, views[kind]) for kind in kinds}
    for name in FILTERS:
        medians = []
        for kind in kinds:
            tracks = run_together(make_filter(name), trials[kind])
            found = map(score, views[kind], trials[kind], tracks)
            medians.append(float(np.median([each.ratio for each in found])))
        table.row(name, *medians)


def calm_table(kept: Figures, seeds: range) -> None:
    """Motions in calm water under a free surface."""
    table = kept.table('calm', 'motion', *HEADER)
    every = []
    for kind in MOTIONS:
        found = []
        for rate, noise, distance, seed in itertools.product(RATES, PIXEL_STDS, DISTANCES, seeds):
            rig = surface_rig(distance)
            views = draw_views(kind, rig, Conditions(rate, noise, distance), seed)
            found.append(score(views, *track(rig, views, **OPTIONS)))
        row(table, kind, found)
        every += found
    row(table, 'all', every)


def waters_table(kept: Figures, seeds: range) -> None:
    """Waters under a free surface."""
    of_both = Column('positions: RMS, mm', '.2f'), Column('poses: RMS, mm', '.2f')
    table = kept.table('waters', 'water', *of_both, *HEADER)
    for name, water in WATERS.items():
        found = []
        for kind, seed in itertools.product(KINDS, seeds):
            rig, views = draw_water(name, kind, seed)
            found.append(score(views, *track(rig, views, **OPTIONS)))
        raw, pose = 1e3 * np.mean([(each.raw, each.pose) for each in found], axis=0)
        row(table, f'{name}, {water.lowest:g}-{water.highest:g} Hz', found, raw, pose)


def calibration_table(kept: Figures, _: range) -> None:
    """A rig whose calibration leaves 2 mm that all frames share, beside 0.3 mm of noise."""
    found = drawn_squares(200)
    columns = Column('stated deviation (mm)', '.2f'), Column('squares', '.2f')
    table = kept.table('drawn', 'drawn 200 times, still target, 10 frames', *columns)
    for name in ('position', 'pose'):
        deviation, squares = getattr(found, name)
        table.row(name, 1e3 * deviation, squares)


def row(table: Table, name: str, found: list[Score], *before: float) -> None:
    """Add a row to a table."""
    ratio = np.array([each.ratio for each in found])
    squares = np.mean([each.normalised for each in found])
    inside = 100.0 * np.mean([each.inside for each in found])
    above = np.count_nonzero(~(ratio <= WORST))
    whole = float(np.median(ratio)), ratio.max(), f'{above} of {ratio.size}', squares, inside
    table.row(name, *before, *whole)


TABLES = {
    'ports': ports_tables,
    'faults': faults_table,
    'opponents': opponents_table,
    'calm': calm_table,
    'waters': waters_table,
    'calibration': calibration_table,
}

if __name__ == '__main__':
    main()
