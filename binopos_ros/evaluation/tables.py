"""The evaluation's tables: rows of words and figures, as CSV, text and HTML show them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.cells import Cell, Span, Table, Value
from binopos_ros.evaluation.claims import claims
from binopos_ros.evaluation.comparison import PAPER_FILTERS, error_ranges, mean_errors
from binopos_ros.evaluation.paper import (
    PAPER_CALM,
    PAPER_GROWTH,
    PAPER_INDICES,
    PAPER_SALT,
    PAPER_SMALLER,
    PAPER_TABLE_5,
    PAPER_TABLE_6,
    PAPER_WAVES,
)
from binopos_ros.evaluation.run import Results
from binopos_ros.evaluation.trials.protocols import CONTROLS, nees_band

Array = NDArray[np.float64]
MILLI = 1e3
RMS = ('RMS x (mm)', 'RMS y (mm)', 'RMS z (mm)', 'RMS, 3-D (mm)')


def tables(results: Results) -> list[Table]:
    """All tables of an evaluation."""
    return [
        claims(results),
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
            (method, *_axes(first), _span(first), _swing(PAPER_CALM) if method == 'paper' else '')
        )
    count = results.settings.experiments
    return Table(
        'transforming',
        'Transforming media (Sec. 5.2, Figure 14): one pair at each of '
        f'{count} places on the floor, calm water',
        ('method', *RMS, 'errors (mm)', "paper's errors (mm)"),
        rows,
        f'Centroid noise {results.settings.pixel_std} px. Straight rays ignore the water.',
    )


def _salted(results: Results) -> Table:
    salt = results.salted
    base = _rms(salt.errors['estimated'])
    rows = []
    for kind, errors in salt.errors.items():
        growth: Cell = Value(100 * (_rms(errors) / base - 1), 1)
        said: Cell = Value(PAPER_GROWTH) if kind.endswith('assumed') else ''
        range_said: Cell = ''
        if kind == 'estimated':
            growth, range_said = '', _swing(PAPER_SALT)
        millimetres = MILLI * errors
        one = MILLI * _rms(salt.single[kind])
        spans = _span(millimetres), range_said
        rows.append((kind, *_axes(millimetres), Value(one), *spans, growth, said))
    return Table(
        'inhomogeneous',
        'Inhomogeneous media (Sec. 5.3, Figure 16): salt gradient, mean index 1.333 to 1.38',
        (
            'index',
            *RMS,
            'RMS, one pair (mm)',
            'errors (mm)',
            "paper's errors (mm)",
            'more error than estimated (%)',
            "paper's (%)",
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
        Span(salt.truth.min(), salt.truth.max(), 4),
        Span(salt.estimate.min(), salt.estimate.max(), 4),
        Value(np.sqrt(np.mean(error**2)), 4),
        Value(np.sqrt(np.mean(salt.index_std**2)), 4),
        Value(float(np.mean((error / salt.index_std) ** 2))),
        Value(int(salt.observed.sum()), 0),
        Value(len(error), 0),
        Span(*PAPER_INDICES),
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
            'of',
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
                *map(Value, (*ranges.mean(axis=0), ranges.mean())),
                Value(MILLI * mean_errors(errors).mean()),
                Value(MILLI * np.sqrt(np.mean(np.sum(errors**2, axis=2)))),
                _swing(PAPER_WAVES[name]) if name in PAPER_WAVES else '',
            )
        )
    return Table(
        'fluctuating',
        'Fluctuating media (Sec. 5.4, Figures 19 and 20): a still target under waves, '
        f'{results.settings.experiments} experiments of {results.settings.frames} frames',
        (
            'filter',
            'error range x (mm)',
            'y (mm)',
            'z (mm)',
            'mean (mm)',
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
            Value(100 * (1 - means[name] / means[other])),
            Value(paper),
        )
        for (name, other), paper in PAPER_SMALLER.items()
    ]
    return Table(
        'smaller',
        'By how much the error range is smaller',
        ('filter', 'here (%)', 'paper (%)'),
        rows,
    )


def _table_5(results: Results) -> Table:
    names = tuple(PAPER_TABLE_5)
    means = np.stack([mean_errors(results.fluctuating[name]) for name in names])
    wins = np.bincount(means.argmin(axis=0), minlength=len(names))
    rows = []
    for number, name in enumerate(names):
        # "The 3D error ranges were converted to Euclidean distance" (Eq. 26): half the range of
        # each axis is what its errors swing to either side.
        count, half, seconds = PAPER_TABLE_5[name]
        swing = MILLI * np.linalg.norm(error_ranges(results.fluctuating[name]).mean(axis=0)) / 2
        rows.append(
            (
                PAPER_FILTERS[name],
                Value(wins[number], 0),
                _swing(swing),
                Value(MILLI * MILLI * results.seconds[name], 0),
                Value(count, 0),
                _swing(half),
                Value(seconds),
            )
        )
    return Table(
        'table_5',
        'Table 5: comparison between the three improved Kalman algorithms',
        (
            'filter',
            'experiments with the smallest mean error',
            'range of mean error (mm)',
            'time per image (us)',
            "paper's count",
            "paper's range (mm)",
            "paper's time (s)",
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
        wins = [Value(np.sum(best[:, axis] == number), 0) for axis in range(3)]
        paper = [Value(count, 0) for count in PAPER_TABLE_6.get(control, (0, 0, 0))]
        rows.append((Value(control, 1), *wins, Value(ranges[number]), *paper))
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
            "paper's y",
            "paper's z",
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
        beaten: Cell = Value(100 * np.mean(own < scores.rms), 0)
        if name == 'cloud-kalman':
            beaten = ''
        rows.append(
            (
                name,
                Value(MILLI * scores.rms.mean()),
                Value(MILLI * np.median(scores.rms)),
                Value(MILLI * scores.high.mean()),
                Value(MILLI * np.median(lags), 0) if lags.size else '',
                Value(scores.consistency.mean()),
                Value(MILLI * MILLI * np.median(scores.seconds), 0),
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
            'median (mm)',
            '99th percentile (mm)',
            'lag (ms)',
            'normalised squared error',
            'time per step (us)',
            'cloud-kalman is better in (%)',
        ),
        rows,
        'Every filter was tuned with the same optimiser, budget and training sequences, none of '
        'them among these. The normalised squared error of an honest covariance lies in '
        f'{low:.2f} .. {high:.2f} (95 % band).',
    )


def _mixed_by_kind(results: Results) -> Table:
    kinds = np.array(results.kinds)
    names = sorted(set(results.kinds))
    rows: list[tuple[Cell, ...]] = [
        (filter_name, *(Value(MILLI * scores.rms[kinds == kind].mean()) for kind in names))
        for filter_name, scores in sorted(
            results.mixed.items(), key=lambda item: item[1].rms.mean()
        )
    ]
    head = ('filter', *(f'{name} (mm)' for name in names))
    return Table('filters_by_path', 'The same by path: mean RMS', head, rows)


def _axes(errors: Array) -> tuple[Value, ...]:
    """RMS of each axis and of the length, of (N, 3) errors in mm."""
    axes = np.sqrt(np.mean(errors**2, axis=0))
    return tuple(map(Value, (*axes, np.sqrt(np.sum(axes**2)))))


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


def _span(errors: Array) -> Span:
    return Span(errors.min(), errors.max())


def _swing(half: float) -> Span:
    return Span(-half, half)
