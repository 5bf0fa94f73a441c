"""Filters side by side: on the paper's experiments, and on sequences of every kind."""

from __future__ import annotations

from collections.abc import Callable
from collections.abc import Sequence as Series
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.protocols import CONTROLS
from binopos_ros.evaluation.trials.score import SETTLING, run, run_together
from binopos_ros.evaluation.trials.sequences import Sequence
from binopos_ros.smoothing import FILTERS, make_filter
from binopos_ros.smoothing.base import Filter

Array = NDArray[np.float64]
Ticker = Callable[[], None]

#: The filters of the paper's comparison, under its own names.
PAPER_FILTERS = {
    'none': 'non-filter',
    'kalman': 'Kalman',
    'cloud-kalman': 'cloud-Kalman',
    'cloud-kalman-paper': "cloud-Kalman as the paper's",
    'sage-husa': 'adaptive Kalman (Sage-Husa)',
    'bp-kalman': 'BP-Kalman',
}
ALL_FILTERS = tuple(FILTERS)

#: A target slower than this has no measurable lag, m/s.
SLOWEST = 0.01


class Scores(NamedTuple):
    """One filter over N sequences.

    Attributes:
        rms: (N,) RMS of the error's length, m.
        high: (N,) its 99th percentile, m.
        lag: (N,) by how much the estimate trails the target, s; nan where the target is still.
        consistency: (N,) average normalised squared error per dimension, 1 if honest.
        seconds: (N,) per step.
    """

    rms: Array
    high: Array
    lag: Array
    consistency: Array
    seconds: Array


def errors_on(
    smoother: Filter[Any], trials: Series[Sequence], tick: Ticker
) -> tuple[Array, float]:
    """Errors (N, frames, 3) in m of a filter on trials, and its time per step in s."""
    tracks = []
    for trial in trials:
        tracks.append(run(smoother, trial))
        tick()
    return (
        np.stack([track.errors for track in tracks]),
        float(np.median([track.seconds for track in tracks])),
    )


def scores_on(smoother: Filter[Any], trials: Series[Sequence], tick: Ticker) -> Scores:
    """Scores of a filter on sequences that it was not tuned on."""
    rows = []
    for trial in trials:
        track = run(smoother, trial)
        error = track.errors[SETTLING:]
        rows.append(
            (
                track.rms,
                np.percentile(np.sqrt(np.sum(error**2, axis=1)), 99),
                lag_of(error, trial.path.velocity[SETTLING:]),
                track.normalised_squared_errors.mean(),
                track.seconds,
            )
        )
        tick()
    return Scores(*np.array(rows, float).T)


def lag_of(errors: Array, velocity: Array) -> float:
    """By how much (s) errors (n, 3) say that an estimate trails a target of that velocity.

    A trailing estimate is off by -lag times the velocity: this is the least-squares lag.
    """
    speed = float(np.sum(velocity**2))
    if speed < len(velocity) * SLOWEST**2:
        return float('nan')
    return float(-np.sum(errors * velocity) / speed)


def errors_by_control(trials: Series[Sequence], tick: Ticker) -> Array:
    """Errors (controls, N, frames, 3), m, of the paper's variant by its control parameter.

    As in the paper's Table 6 the number takes the certainty's place, and the cloud holds all
    positions so far.
    """
    errors = []
    for control in CONTROLS:
        smoother = make_filter(
            'cloud-kalman', variant='paper', parameter='constant', control=control, window=100
        )
        errors.append(np.stack([track.errors for track in run_together(smoother, trials)]))
        tick()
    return np.array(errors)


def error_ranges(errors: Array) -> Array:
    """(N, 3) largest minus smallest error of each axis after a second of settling."""
    return np.asarray(np.ptp(errors[:, SETTLING:], axis=1))


def mean_errors(errors: Array) -> Array:
    """(N,) mean Euclidean error (Eq. 26) over all frames."""
    return np.asarray(np.linalg.norm(errors, axis=2).mean(axis=1))
