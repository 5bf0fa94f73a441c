"""Calibration of the default filter's covariance: honest on average, and for each kind of path.

A hypothesis that holds for seconds is surer than its covariance says, and one that is about to be
given up less sure. So of the covariance given out five parts have a factor: what the hypotheses of
wavy water say themselves, by motion, and how far the means of all are apart.
"""

from __future__ import annotations

from collections.abc import Sequence as Series

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.paths import KINDS
from binopos_ros.evaluation.trials.score import SETTLING, run_together
from binopos_ros.evaluation.trials.sequences import Sequence
from binopos_ros.evaluation.trials.tuning import minimise
from binopos_ros.smoothing.factory import make_filter

Array = NDArray[np.float64]

#: The options that are factors on parts of the covariance.
SCALES = ('paused_scale', 'resting_scale', 'steady_scale', 'turning_scale', 'means_scale')
_LOWEST, _HIGHEST = 0.01, 40.0
_BUDGET = 301
#: How much the average over all paths, and the scatter over sequences, count beside the kinds.
_AVERAGE, _SCATTER = 20.0, 0.3


class Calibration:
    """The squared errors of the default filter with `options` as a function of the factors."""

    def __init__(self, trials: Series[Sequence], **options: float) -> None:
        self._kinds = np.array([trial.kind for trial in trials])
        covariances = []
        # The factors change only what is given out, and that by a sum: one run for each tells all.
        for chosen in (None, *SCALES):
            scales = {name: float(name == chosen) for name in SCALES}
            tracks = run_together(make_filter('cloud-kalman', **{**options, **scales}), trials)
            covariances.append([track.covariances[SETTLING:] for track in tracks])
        self._rest = np.array(covariances[0])
        self._parts = np.array(covariances[1:]) - self._rest
        self._errors = np.array([track.errors[SETTLING:] for track in tracks])

    def normalised(self, scales: Array) -> Array:
        """Return the mean normalised squared error (N,) of each sequence, for factors (5,)."""
        covariances = self._rest + np.tensordot(scales, self._parts, axes=1)
        solved = np.linalg.solve(covariances, self._errors[..., None])[..., 0]
        return np.sum(self._errors * solved, axis=2).mean(axis=1) / 3.0

    def objective(self, scales: Array) -> float:
        """Return what is to be small: how far averages are from 1, and the sequences' scatter."""
        errors = self.normalised(scales)
        kinds = [np.log(errors[self._kinds == kind].mean()) ** 2 for kind in KINDS]
        average = np.log(errors.mean()) ** 2
        return float(np.sum(kinds) + _AVERAGE * average + _SCATTER * errors.var())

    def best(self) -> dict[str, float]:
        """Return the factors that :meth:`objective` is smallest for, then made 1 on average."""
        place, _ = minimise(lambda at: self.objective(_scales(at)), len(SCALES), _BUDGET)
        scales = _rounded(_scales(place))
        scales = _rounded(scales * self.normalised(scales).mean())
        return dict(zip(SCALES, scales.tolist(), strict=True))


def _rounded(scales: Array) -> Array:
    return np.array([float(f'{scale:.3g}') for scale in scales])


def _scales(place: Array) -> Array:
    """Return the factors at a place in the unit cube of their logarithms."""
    return np.asarray(_LOWEST * (_HIGHEST / _LOWEST) ** np.clip(place, 0.0, 1.0))
