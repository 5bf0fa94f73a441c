"""`binopos calibrate report`: the accuracy map as words, and as a page with its picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from binopos_ros.calibration.report import pictures
from binopos_ros.calibration.report.accuracy import (
    AccuracyMap,
    Spread,
    accuracy_map,
    with_baseline,
)
from binopos_ros.calibration.report.files import write_text
from binopos_ros.calibration.report.page import page, picture
from binopos_ros.optics.rig_state import RigState
from binopos_ros.sheet import Made, table

BASELINES = (0.5, 1.0, 1.5, 2.0)  # times the rig's own
ENOUGH = 0.95  # of the volume
HEAD = ('distance (m)', 'along', 'across', 'along, known exactly', 'across, known exactly')
BASELINE_HEAD = ('baseline (mm)', 'along, median', 'across, median', 'within what is wanted')
CAPTION = (
    'Standard deviations of one position in a level slice through the working volume, along the '
    "line of sight and across it: above with the calibration's own errors, below of a rig that is "
    'known exactly. Where the two rows agree better calibration pictures help no more.'
)


def distance_rows(found: AccuracyMap) -> list[tuple[str, ...]]:
    """The nearest, the middle and the farthest distance: medians over what both cameras see."""
    rows: list[tuple[str, ...]] = []
    for i in (0, len(found.z) // 2, len(found.z) - 1):
        values = [
            _median(each[i])
            for one in (found.whole, found.exact)
            for each in (one.along, one.across)
        ]
        rows.append((f'{found.z[i]:.2f}', *(_millimetres(value) for value in values)))
    return rows


def baseline_rows(
    state: RigState,
    covariance: np.ndarray,
    noise: float,
    reach: tuple[float, float],
    wanted: float,
) -> list[tuple[str, ...]]:
    """What other baselines would give, the calibration's deviations taken as they are."""
    rows: list[tuple[str, ...]] = []
    for factor in BASELINES:
        found = accuracy_map(with_baseline(state, factor), covariance, noise, reach)
        baseline = 1000.0 * factor * float(np.linalg.norm(state.translation))
        here = ' (this rig)' if factor == 1.0 else ''
        rows.append(
            (
                f'{baseline:.0f}{here}',
                _millimetres(_median(found.whole.along)),
                _millimetres(_median(found.whole.across)),
                f'{100 * good_share(found.whole, wanted):.0f} %',
            )
        )
    return rows


def good_share(spread: Spread, wanted: float) -> float:
    """The part of what both cameras see where a position's deviation is at most `wanted` (m)."""
    length = np.hypot(spread.along, spread.across)
    return float(np.mean(length[np.isfinite(length)] <= wanted))


def answer(found: AccuracyMap, wanted: float) -> str:
    """Is the rig good enough, and if not, what would help."""
    share, best = good_share(found.whole, wanted), good_share(found.exact, wanted)
    lead = (
        f'A position is good to {1000 * wanted:g} mm in {100 * share:.0f} % of what both cameras '
        f'see from {found.z[0]:.2f} to {found.z[-1]:.2f} m'
    )
    if share > ENOUGH:
        return f'{lead}: the rig is good enough.'
    if best > ENOUGH:
        return (
            f'{lead}; of a rig that is known exactly {100 * best:.0f} %: calibrate better, with '
            'more and larger boards.'
        )
    return (
        f'{lead}, and of a rig that is known exactly in {100 * best:.0f} %: no calibration makes '
        'this rig good enough; a wider baseline, longer lenses, or a nearer target do.'
    )


def accuracy_page(
    folder: Path,
    found: AccuracyMap,
    baselines: list[tuple[str, ...]],
    wanted: float,
    made: Made,
) -> Path:
    """Write accuracy.html; its path."""
    sections = [
        ('By distance (mm)', table(distance_rows(found), HEAD)),
        ('Other baselines (mm)', table(baselines, BASELINE_HEAD)),
    ]
    if pictures.available():
        sections.append(
            picture('Accuracy over the working volume', CAPTION, pictures.accuracy(found))
        )
    path = folder / 'accuracy.html'
    write_text(path, page('How accurate is this rig?', answer(found, wanted), sections, made))
    return path


def accuracy_text(found: AccuracyMap, baselines: list[tuple[str, ...]], wanted: float) -> str:
    """The same for the terminal, standard deviations in mm."""
    lines = [*_columns([HEAD, *distance_rows(found)]), '', *_columns([BASELINE_HEAD, *baselines])]
    return '\n'.join([*lines, '', answer(found, wanted)])


def _columns(rows: list[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ['  '.join(cell.rjust(w) for cell, w in zip(row, widths, strict=True)) for row in rows]


def _median(values: np.ndarray) -> float:
    seen = values[np.isfinite(values)]
    return float(np.median(seen)) if len(seen) else float('nan')


def _millimetres(value: float) -> str:
    return f'{1000.0 * value:.2f}' if np.isfinite(value) else '-'
