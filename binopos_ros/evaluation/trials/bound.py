"""What no filter can beat: the batch solution that knows the waves and the way the target moves.

The waves' covariance over time is measured on fresh surfaces of the same spectrum over the same
scene, wrong detections are taken out, and the target's acceleration has at each instant the true
one's variance. Given that, everything is Gaussian, and the best estimate from all positions (a
smoother's) and from those up to each instant (a filter's) are both linear algebra; Rauch, Tung &
Striebel, AIAA J. 3(8), 1965, would reach the same by recursion. Axes are taken apart, along and
across the line of sight.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.evaluation.trials.sequences import Sequence

Array = NDArray[np.float64]

_SURFACES = 6
#: Deviations beyond which a wave's error is taken for a focus and cut.
_LARGEST = 6.0
#: Correlation time of a target's acceleration (s).
_TURN_TIME = 0.3
#: Variances of the first position (m^2) and velocity (m^2/s^2) about the first measurement.
_FIRST_POSITION, _FIRST_VELOCITY = 1.0, 0.1


class Bound(NamedTuple):
    """Errors (n, 3), m, of the best filter and of the best smoother."""

    filtered: Array
    smoothed: Array


def best_possible(sequence: Sequence) -> Bound:
    """Return the errors of the estimators that know all there is to know."""
    axes = _axes(sequence)
    covariances = _wave_covariances(sequence, axes, np.random.default_rng(7))
    motion = _motion_covariance(sequence)
    used = np.isfinite(sequence.positions[:, 0]) & ~sequence.wrong
    origin = sequence.truth[0]
    noise = np.einsum('ki,nij,kj->nk', axes, sequence.covariances[used], axes)
    filtered, smoothed = np.empty_like(sequence.truth), np.empty_like(sequence.truth)
    for axis in range(3):
        measured = (sequence.positions[used] - origin) @ axes[axis]
        joint = motion[np.ix_(used, used)] + covariances[axis][np.ix_(used, used)]
        joint[np.diag_indices_from(joint)] += noise[:, axis]
        # The Cholesky factor whitens row by row, each row from those before it: the innovations.
        root = np.linalg.cholesky(joint)
        whitened = np.linalg.solve(root, np.column_stack([motion[used], measured]))
        parts = whitened[:, :-1] * whitened[:, -1:]
        before = np.flatnonzero(used)[:, None] <= np.arange(len(sequence.stamps))
        truth = (sequence.truth - origin) @ axes[axis]
        filtered[:, axis] = np.sum(parts * before, axis=0) - truth
        smoothed[:, axis] = parts.sum(axis=0) - truth
    return Bound(filtered @ axes, smoothed @ axes)


def _axes(sequence: Sequence) -> Array:
    """Return axes (3, 3), rows: the last along the line of sight to the middle of the path."""
    valid = np.isfinite(sequence.covariances[:, 0, 0])
    _, vectors = np.linalg.eigh(np.mean(sequence.covariances[valid], axis=0))
    return np.asarray(vectors.T)


def _wave_covariances(sequence: Sequence, axes: Array, random: np.random.Generator) -> Array:
    """Return the covariances (3, n, n) over time of the waves' errors, m^2."""
    count = sequence.stamps.size
    sums = np.zeros((3, count))
    for _ in range(_SURFACES):
        waves = sequence.spectrum.realise(random)
        left, right = sequence.basin.pixels(
            sequence.truth, sequence.stamps, waves, sequence.envelope
        )
        error = (sequence.basin.triangulate(left, right) - sequence.truth) @ axes.T
        scaled = error / sequence.envelope[:, None]
        for axis in range(3):
            series = np.where(np.isfinite(scaled[:, axis]), scaled[:, axis], 0.0)
            series = np.clip(series, -_LARGEST * series.std(), _LARGEST * series.std())
            # Dividing by n at every lag keeps the Toeplitz matrix positive semidefinite.
            power = np.abs(np.fft.rfft(series, 2 * count)) ** 2
            sums[axis] += np.fft.irfft(power)[:count] / count
    envelope = np.outer(sequence.envelope, sequence.envelope)
    lags = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    return np.stack([row[lags] / _SURFACES * envelope for row in sums])


def _motion_covariance(sequence: Sequence) -> Array:
    """Return the prior covariance (n, n) of the target's position over time, per axis, m^2."""
    time = sequence.stamps - sequence.stamps[0]
    constant = np.full((time.size, time.size), _FIRST_POSITION)
    if sequence.kind == 'still':
        return constant
    acceleration = np.mean(sequence.path.acceleration**2, axis=1)
    width = max(int(_TURN_TIME / np.median(np.diff(time))), 1)
    usual = np.convolve(np.pad(acceleration, width, mode='edge'), np.ones(2 * width + 1), 'valid')
    # White acceleration of the density that gives this variance over the correlation time.
    density = usual / (2 * width + 1) * 2.0 * _TURN_TIME + 1e-10
    reach = np.maximum(time[:, None] - time[None, :], 0.0)
    steps = np.gradient(time)
    return constant + _FIRST_VELOCITY * np.outer(time, time) + (reach * density * steps) @ reach.T
