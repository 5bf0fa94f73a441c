"""The trials that the filters are compared in, and their figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from collections.abc import Sequence as Series
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.score import SETTLING, Track, run_together
from binopos_ros.evaluation.trials.sequences import Sequence
from binopos_ros.smoothing.base import Filter
from binopos_ros.smoothing.factory import make_filter

Array = NDArray[np.float64]

#: The paper's choice of control parameters in its Table 6.
CONTROLS = tuple(value / 2.0 for value in range(-8, 9) if value != 0)

Runner = Callable[[Filter[Any], Series[Sequence]], list[Track]]


class PaperResult(NamedTuple):
    """One filter in the paper's experiments; N of them.

    Attributes
    ----------
    ranges : (N, 3) array
        Largest minus smallest error per axis (m), once the filter has settled for a second.
    whole_ranges : (N, 3) array
        The same over all frames, the first, which no filter can change, included.
    means : (N,) array
        Mean Euclidean error (Eq. 26) over all frames (m).

    """

    ranges: Array
    whole_ranges: Array
    means: Array


def paper_protocol(
    names: Iterable[str], trials: Series[Sequence], runner: Runner = run_together
) -> dict[str, PaperResult]:
    """Return what each filter makes of the paper's experiments."""
    return {name: _paper_result(runner(make_filter(name), trials)) for name in names}


def smaller(result: PaperResult, than: PaperResult) -> float:
    """Return by which share the mean error range is smaller than another filter's."""
    return float(1.0 - result.ranges.mean() / than.ranges.mean())


def mixed_protocol(
    names: Iterable[str], trials: Series[Sequence], runner: Runner = run_together
) -> dict[str, list[Track]]:
    """Return the tracks of each filter over the mixed sequences."""
    return {name: runner(make_filter(name), trials) for name in names}


def rms(tracks: Iterable[Track]) -> Array:
    """Return the RMS errors (N,) of tracks, m."""
    return np.array([track.rms for track in tracks])


def average_nees(tracks: Iterable[Track]) -> float:
    """Return the average normalised squared error per dimension: 1 for an honest covariance."""
    return float(np.mean([track.normalised_squared_errors.mean() for track in tracks]))


def nees_band(count: int) -> tuple[float, float]:
    """Return the 95 % band of the average over `count` independent runs, three dimensions each.

    Bar-Shalom, Li & Kirubarajan 2001, Sec. 5.4.2; the chi-square's quantiles by Wilson & Hilferty,
    PNAS 17, 1931, which is exact to 1e-4 here.
    """
    freedom = 3.0 * count
    spread = np.sqrt(2.0 / (9.0 * freedom))
    low, high = (float((1.0 - spread**2 + z * spread) ** 3) for z in (-1.959964, 1.959964))
    return low, high


def control_experiment(
    trials: Series[Sequence], controls: Iterable[float] = CONTROLS
) -> dict[float, Array]:
    """Return the mean absolute errors (N, 3), m, of the paper's variant by control parameter.

    As in the paper's Table 6, the number takes the certainty's place, and the cloud holds all
    positions so far.
    """
    result = {}
    for control in controls:
        options = {'parameter': 'constant', 'control': control, 'window': 100}
        smoother = make_filter('cloud-kalman', variant='paper', **options)
        tracks = run_together(smoother, trials)
        result[control] = np.stack([np.abs(track.errors).mean(axis=0) for track in tracks])
    return result


def _paper_result(tracks: Iterable[Track]) -> PaperResult:
    errors = np.stack([track.errors for track in tracks])
    settled = errors[:, SETTLING:]
    return PaperResult(
        np.ptp(settled, axis=1),
        np.ptp(errors, axis=1),
        np.linalg.norm(errors, axis=2).mean(axis=1),
    )
