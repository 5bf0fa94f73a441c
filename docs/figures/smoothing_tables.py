"""Print the tables of docs/smoothing.md and draw its figure.

python docs/figures/smoothing_tables.py [--figure FILE.png]

Everything is seeded; it takes a few minutes. Times per step are bench/smoothing/speed.py's.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence as Series
from typing import Any

import numpy as np

from binopos_ros.evaluation.trials.bound import best_possible
from binopos_ros.evaluation.trials.paths import KINDS
from binopos_ros.evaluation.trials.protocols import (
    average_nees,
    control_experiment,
    mixed_protocol,
    nees_band,
    paper_protocol,
    rms,
    smaller,
)
from binopos_ros.evaluation.trials.score import SETTLING, Track, run
from binopos_ros.evaluation.trials.sequences import (
    TRAINING_SEED,
    Sequence,
    paper_set,
    unseen_set,
)
from binopos_ros.evaluation.trials.tuning import SEARCHED, minimise, objective, options_at
from binopos_ros.smoothing import FILTERS, Filter, make_filter

OURS = 'cloud-kalman'
MM = 1e3


def main() -> None:
    """Run the protocols one after the other."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--figure', metavar='FILE', help='also draw errors over time to FILE')
    parser.add_argument('--sequences', type=int, default=200, help='of the mixed protocol')
    arguments = parser.parse_args()
    paper_table()
    control_table()
    trials = unseen_set(arguments.sequences)
    tracks = mixed_protocol(FILTERS, trials, with_shell)
    mixed_table(tracks, trials)
    kind_table(tracks, trials)
    if arguments.figure:
        draw(arguments.figure)


def with_shell(smoother: Filter[Any], trials: Series[Sequence]) -> list[Track]:
    """Run the filter as the node does: with checks and starting afresh."""
    return [run(smoother, trial) for trial in trials]


def paper_table() -> None:
    """The paper's experiments: 100 of 100 frames at a still target."""
    trials = paper_set(100)
    results = paper_protocol(FILTERS, trials, with_shell)
    print('\n### Paper: 100 experiments of 100 frames, still target\n')
    print('| filter | range x, y, z (mm) | range with the first second (mm) | mean error (mm) |')
    print('|---|---|---|---|')
    for name, result in results.items():
        ranges = ', '.join(f'{value:.2f}' for value in MM * result.ranges.mean(axis=0))
        whole = MM * result.whole_ranges.mean()
        print(f'| {name} | {ranges} | {whole:.2f} | {MM * result.means.mean():.2f} |')
    ours = results[OURS]
    for other in ('none', 'kalman'):
        print(f'\nerror range smaller than {other}: {100 * smaller(ours, results[other]):.1f} %')
    whole = 1 - ours.whole_ranges.mean() / results['kalman'].whole_ranges.mean()
    print(f'\nthe same with the first second, against kalman: {100 * whole:.1f} %')
    names = (OURS, 'sage-husa', 'bp-kalman')
    wins = np.bincount(
        np.stack([results[name].means for name in names]).argmin(axis=0), minlength=3
    )
    print(f'\nsmallest mean error: {dict(zip(names, wins.tolist(), strict=True))}')
    options = tuned_for_the_paper('kalman')
    special = with_shell(make_filter('kalman', **options), trials)
    spans = [np.ptp(track.errors[SETTLING:], axis=0) for track in special]
    share = 1 - ours.ranges.mean() / np.mean(spans)
    print(f'\nkalman tuned on still targets alone: {options}')
    print(f'its range {MM * np.mean(spans):.2f} mm; ours is {100 * share:.1f} % smaller')


def tuned_for_the_paper(name: str) -> dict[str, float]:
    """Return a filter's options tuned on experiments like the paper's, of other seeds."""
    training = paper_set(40, TRAINING_SEED)
    place, _ = minimise(
        lambda at: objective(name, options_at(name, at), training), len(SEARCHED[name]), 201
    )
    return options_at(name, place)


def control_table() -> None:
    """The paper's Table 6: how often each control parameter gives the smallest error."""
    errors = control_experiment(paper_set(100))
    smallest = np.stack(list(errors.values())).argmin(axis=0)
    print('\n### Table 6: experiments with the smallest mean error, by control parameter\n')
    print('| control | x | y | z | mean error x, y, z (mm) |')
    print('|---|---|---|---|---|')
    for number, (control, error) in enumerate(errors.items()):
        counts = ' | '.join(str(value) for value in (smallest == number).sum(axis=0))
        means = ', '.join(f'{value:.3g}' for value in MM * error.mean(axis=0))
        print(f'| {control:g} | {counts} | {means} |')


def mixed_table(tracks: dict[str, list[Track]], trials: Series[Sequence]) -> None:
    """The mixed protocol: every filter against ours."""
    ours = rms(tracks[OURS])
    print(f'\n### Mixed: {len(trials)} unseen sequences\n')
    print(
        '| filter | mean RMS (mm) | geometric mean | 99th percentile of errors | ours better in |'
    )
    print('|---|---|---|---|---|')
    for name, result in tracks.items():
        theirs = rms(result)
        lengths = [np.linalg.norm(track.errors[SETTLING:], axis=1) for track in result]
        better = '' if name == OURS else f'{100 * np.mean(ours < theirs):.1f} %'
        print(
            f'| {name} | {MM * theirs.mean():.2f} | {MM * np.exp(np.log(theirs).mean()):.2f} | '
            f'{MM * np.percentile(np.concatenate(lengths), 99):.1f} | {better} |'
        )
    low, high = nees_band(len(trials))
    print(f'\naverage normalised squared error, 95 % band {low:.3f} to {high:.3f}:')
    print(', '.join(f'{name} {average_nees(result):.3g}' for name, result in tracks.items()))


def kind_table(tracks: dict[str, list[Track]], trials: Series[Sequence]) -> None:
    """The mixed protocol by kind of path, with the bound."""
    bounds = [best_possible(trial) for trial in trials]
    kinds = np.array([trial.kind for trial in trials])
    ours, none = rms(tracks[OURS]), rms(tracks['none'])
    print('\n### Mixed, by kind of path\n')
    print(
        '| path | unfiltered (mm) | ours (mm) | ours / unfiltered: mean, largest | '
        'knowing waves and motion: filter, smoother (mm) | normalised squared error |'
    )
    print('|---|---|---|---|---|---|')
    for kind in KINDS:
        chosen = np.flatnonzero(kinds == kind)
        ratio = ours[chosen] / none[chosen]
        known = [
            np.mean([length(getattr(bounds[number], part)) for number in chosen])
            for part in ('filtered', 'smoothed')
        ]
        nees = average_nees([tracks[OURS][number] for number in chosen])
        print(
            f'| {kind} | {MM * none[chosen].mean():.2f} | {MM * ours[chosen].mean():.2f} | '
            f'{ratio.mean():.3f}, {ratio.max():.3f} | '
            f'{MM * known[0]:.2f}, {MM * known[1]:.2f} | {nees:.2f} |'
        )


def length(errors: np.ndarray) -> float:
    """Return the RMS of the errors' lengths after settling."""
    return float(np.sqrt(np.mean(np.sum(errors[SETTLING:] ** 2, axis=1))))


def draw(path: str) -> None:
    """Draw the depth error over time in four sequences: unfiltered, Kalman, ours."""
    import matplotlib as mpl

    mpl.use('Agg')
    from matplotlib import pyplot as plt

    trials = [unseen_set(5)[number] for number in (0, 2, 3, 4)]
    figure, axes = plt.subplots(len(trials), 1, figsize=(8, 9), sharex=True, layout='constrained')
    for axis, trial in zip(axes, trials, strict=True):
        time = trial.stamps - trial.stamps[0]
        for name, colour in (('none', '0.75'), ('kalman', 'tab:orange'), (OURS, 'tab:blue')):
            error = run(make_filter(name), trial).errors[:, 2]
            axis.plot(time, MM * error, color=colour, label=name, linewidth=1)
        axis.set_ylim(-60, 60)
        axis.set_title(trial.kind, fontsize='medium')
        axis.set_ylabel('depth error (mm)')
    axes[0].legend(ncols=3, loc='upper right')
    axes[-1].set_xlabel('time (s)')
    figure.savefig(path, dpi=100)


if __name__ == '__main__':
    main()
