"""The evaluation's tables: rows of words, as CSV, text and HTML show them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.comparison import PAPER_FILTERS, error_ranges, mean_errors
from binopos_ros.evaluation.run import Results
from binopos_ros.evaluation.trials.protocols import CONTROLS, nees_band

Array = NDArray[np.float64]
MILLI = 1e3

#: What the paper prints (Sec. 5.2 to 5.4, Tables 5 and 6), for the last column of our tables.
PAPER_RANGE = '-4 .. 4'
PAPER_SALT_RANGE = '-0.37 .. 0.37'
PAPER_GROWTH = 12.45
PAPER_SMALLER = {
    ('kalman', 'none'): 10.67,
    ('cloud-kalman', 'kalman'): 23.34,
    ('cloud-kalman', 'none'): 31.73,
}
PAPER_RANGES = {'none': '-3.3 .. 3.3', 'kalman': '-3.3 .. 3.3', 'cloud-kalman': '-2.5 .. 2.5'}
PAPER_TABLE_5 = {
    'cloud-kalman': ('97', '-4.36 .. 4.36', '5548.95 s'),
    'sage-husa': ('2', '-4.73 .. 4.73', '5672.62 s'),
    'bp-kalman': ('1', '-4.64 .. 4.64', '5590.16 s'),
}
PAPER_TABLE_6 = {
    -1.0: (0, 2, 1),
    -0.5: (3, 2, 2),
    0.5: (7, 3, 3),
    1.0: (85, 87, 91),
    1.5: (4, 6, 2),
    2.0: (1, 0, 1),
}


class Table(NamedTuple):
    """A table with a name for its file, a title, and what to know when reading it."""

    name: str
    title: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ''


def tables(results: Results) -> list[Table]:
    """All tables of an evaluation."""
    return [
        _transforming(results),
        _salted(results),
        _index(results),
        _ranges(results),
        _smaller(results),
        _table_5(results),
        _table_6(results),
        _mixed(results),
        _mixed_by_kind(results),
    ]


def _transforming(results: Results) -> Table:
    rows = []
    for method, errors in results.transforming.items():
        first = MILLI * errors[:, 0]
        rows.append(
            (method, *_axes(first), _span(first), PAPER_RANGE if method == 'paper' else '')
        )
    count = results.settings.experiments
    return Table(
        'transforming',
        'Transforming media (Sec. 5.2, Figure 14): one pair at each of '
        f'{count} places on the floor, calm water',
        ('method', 'RMS x (mm)', 'y', 'z', '3-D', 'errors (mm)', "paper's errors (mm)"),
        rows,
        f'Centroid noise {results.settings.pixel_std} px. Straight rays ignore the water.',
    )


def _salted(results: Results) -> Table:
    salt = results.salted
    base = _rms(salt.errors['estimated'])
    rows = []
    for kind, errors in salt.errors.items():
        growth = f'{100 * (_rms(errors) / base - 1):+.1f} %'
        said = f'+{PAPER_GROWTH} %' if kind.endswith('assumed') else ''
        if kind == 'estimated':
            growth, said = '', PAPER_SALT_RANGE
        millimetres = MILLI * errors
        one = MILLI * _rms(salt.single[kind])
        rows.append((kind, *_axes(millimetres), f'{one:.2f}', _span(millimetres), growth, said))
    return Table(
        'inhomogeneous',
        'Inhomogeneous media (Sec. 5.3, Figure 16): salt gradient, mean index 1.333 to 1.38',
        (
            'index',
            'RMS x (mm)',
            'y',
            'z',
            '3-D',
            '3-D, one pair',
            'errors (mm)',
            'more error than estimated',
            "paper's",
        ),
        rows,
        f'Position from {results.settings.frames} pairs at one place. A pair says little of the '
        'index at places that are about as far from both cameras, so it is accumulated from '
        'place to place. The first row is what is left once the index is known.',
    )


def _index(results: Results) -> Table:
    salt = results.salted
    error = salt.estimate - salt.truth
    row = (
        f'{salt.truth.min():.4f} .. {salt.truth.max():.4f}',
        f'{salt.estimate.min():.4f} .. {salt.estimate.max():.4f}',
        f'{np.sqrt(np.mean(error**2)):.4f}',
        f'{np.sqrt(np.mean(salt.index_std**2)):.4f}',
        f'{np.mean((error / salt.index_std) ** 2):.2f}',
        f'{int(salt.observed.sum())} of {len(error)}',
        '1.33 .. 1.52',
    )
    return Table(
        'index',
        'Mean refractive index (Figure 17)',
        (
            'true',
            'estimated',
            'RMS error',
            'stated deviation',
            'squared error by stated variance',
            'said to be observed',
            "paper's",
        ),
        [row],
    )


def _ranges(results: Results) -> Table:
    rows = []
    for name, errors in results.fluctuating.items():
        ranges = MILLI * error_ranges(errors)
        rows.append(
            (
                PAPER_FILTERS[name],
                *(f'{value:.2f}' for value in (*ranges.mean(axis=0), ranges.mean())),
                f'{MILLI * mean_errors(errors).mean():.2f}',
                f'{MILLI * np.sqrt(np.mean(np.sum(errors**2, axis=2))):.2f}',
                PAPER_RANGES.get(name, ''),
            )
        )
    return Table(
        'fluctuating',
        'Fluctuating media (Sec. 5.4, Figures 19 and 20): a still target under waves, '
        f'{results.settings.experiments} experiments of {results.settings.frames} frames',
        (
            'filter',
            'error range x (mm)',
            'y',
            'z',
            'mean',
            'mean Euclidean error (mm)',
            'RMS (mm)',
            "paper's errors (mm)",
        ),
        rows,
        'Error range: largest minus smallest error of an axis after the first second, averaged '
        'over the experiments. Euclidean error (Eq. 26) and RMS count every frame.',
    )


def _smaller(results: Results) -> Table:
    means = {name: error_ranges(errors).mean() for name, errors in results.fluctuating.items()}
    rows = [
        (
            f'{PAPER_FILTERS[name]} than {PAPER_FILTERS[other]}',
            f'{100 * (1 - means[name] / means[other]):.2f} %',
            f'{paper} %',
        )
        for (name, other), paper in PAPER_SMALLER.items()
    ]
    return Table(
        'smaller', 'By how much the error range is smaller', ('filter', 'here', 'paper'), rows
    )


def _table_5(results: Results) -> Table:
    names = tuple(PAPER_TABLE_5)
    means = np.stack([mean_errors(results.fluctuating[name]) for name in names])
    wins = np.bincount(means.argmin(axis=0), minlength=len(names))
    rows = []
    for number, name in enumerate(names):
        # "The 3D error ranges were converted to Euclidean distance" (Eq. 26): half the range of
        # each axis is what its errors swing to either side.
        swing = MILLI * np.linalg.norm(error_ranges(results.fluctuating[name]).mean(axis=0)) / 2
        rows.append(
            (
                PAPER_FILTERS[name],
                str(wins[number]),
                f'{-swing:.2f} .. {swing:.2f}',
                f'{MILLI * MILLI * results.seconds[name]:.0f} us',
                *PAPER_TABLE_5[name],
            )
        )
    return Table(
        'table_5',
        'Table 5: comparison between the three improved Kalman algorithms',
        (
            'filter',
            'experiments with the smallest mean error',
            'range of mean error (mm)',
            'time per image',
            "paper's count",
            "paper's range",
            "paper's time",
        ),
        rows,
        "The paper's 5,549 s per image cannot be seconds per image.",
    )


def _table_6(results: Results) -> Table:
    means = np.abs(results.controls).mean(axis=2)
    best = means.argmin(axis=0)
    ranges = MILLI * np.ptp(results.controls, axis=2).mean(axis=(1, 2))
    rows = []
    for number, control in enumerate(CONTROLS):
        wins = [int(np.sum(best[:, axis] == number)) for axis in range(3)]
        paper = PAPER_TABLE_6.get(control, (0, 0, 0))
        rows.append((f'{control:g}', *map(str, wins), _number(ranges[number]), *map(str, paper)))
    return Table(
        'table_6',
        'Table 6 and Figure 21: comparison between parameter adjustment effects',
        (
            'control parameter',
            'experiments with the smallest error, x',
            'y',
            'z',
            'error range (mm)',
            "paper's x",
            'y',
            'z',
        ),
        rows,
        "The paper's variant of the filter, the number in the certainty's place (Eq. 16).",
    )


def _mixed(results: Results) -> Table:
    own = results.mixed['cloud-kalman'].rms
    low, high = nees_band(len(results.kinds))
    rows = []
    for name, scores in sorted(results.mixed.items(), key=lambda item: item[1].rms.mean()):
        lags = scores.lag[np.isfinite(scores.lag)]
        beaten = f'{100 * np.mean(own < scores.rms):.0f} %' if name != 'cloud-kalman' else ''
        rows.append(
            (
                name,
                f'{MILLI * scores.rms.mean():.2f}',
                f'{MILLI * np.median(scores.rms):.2f}',
                f'{MILLI * scores.high.mean():.2f}',
                f'{MILLI * np.median(lags):.0f}' if lags.size else '',
                f'{scores.consistency.mean():.2f}',
                f'{MILLI * MILLI * np.median(scores.seconds):.0f}',
                beaten,
            )
        )
    return Table(
        'filters',
        f'All filters on {len(results.kinds)} unseen sequences: still to manoeuvring, calm to '
        'rough, wrong detections and gaps',
        (
            'filter',
            'RMS, mean (mm)',
            'median',
            '99th percentile (mm)',
            'lag (ms)',
            'normalised squared error',
            'time per step (us)',
            'cloud-kalman is better in',
        ),
        rows,
        'Every filter was tuned with the same optimiser, budget and training sequences, none of '
        'them among these. The normalised squared error of an honest covariance lies in '
        f'{low:.2f} .. {high:.2f} (95 % band).',
    )


def _mixed_by_kind(results: Results) -> Table:
    kinds = np.array(results.kinds)
    names = sorted(set(results.kinds))
    rows = [
        (filter_name, *(f'{MILLI * scores.rms[kinds == kind].mean():.2f}' for kind in names))
        for filter_name, scores in sorted(
            results.mixed.items(), key=lambda item: item[1].rms.mean()
        )
    ]
    return Table('filters_by_path', 'The same by path: mean RMS in mm', ('filter', *names), rows)


def _axes(errors: Array) -> tuple[str, ...]:
    """RMS of each axis and of the length, of (N, 3) errors in mm."""
    axes = np.sqrt(np.mean(errors**2, axis=0))
    return tuple(f'{value:.2f}' for value in (*axes, np.sqrt(np.sum(axes**2))))


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def _span(errors: Array) -> str:
    return f'{errors.min():.2f} .. {errors.max():.2f}'


def _number(value: float) -> str:
    return f'{value:.2f}' if abs(value) < 1e4 else f'{value:.1e}'
