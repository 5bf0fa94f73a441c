"""Filters run over sequences, and what comes of it."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Filter
from binopos_ros.smoothing.trials.sequences import Sequence

Array = NDArray[np.float64]

#: Frames at the start that no score counts: one second, in which a filter finds its feet.
SETTLING = 30


@dataclasses.dataclass(frozen=True)
class Track:
    """What a filter made of a sequence of n frames.

    Attributes
    ----------
    errors : (n, 3) array
        Filtered minus true position (m); predictions where the frame gave no position.
    covariances : (n, 3, 3) array
        Of the filtered positions (m^2).
    seconds : float
        Time per step.

    """

    errors: Array
    covariances: Array
    seconds: float

    @property
    def rms(self) -> float:
        """RMS of the error's length after the settling (m)."""
        return float(np.sqrt(np.mean(np.sum(self.errors[SETTLING:] ** 2, axis=1))))

    @property
    def normalised_squared_errors(self) -> Array:
        """Squared errors by their own covariance, per dimension (n - SETTLING,); 1 if honest."""
        error = self.errors[SETTLING:]
        solved = np.linalg.solve(self.covariances[SETTLING:], error[:, :, None])[:, :, 0]
        return np.sum(error * solved, axis=1) / 3.0


def run(smoother: Filter[Any], sequence: Sequence) -> Track:
    """Run a filter, started afresh, over a sequence."""
    smoother.reset()
    count = sequence.stamps.size
    estimates, spreads = np.empty((count, 3)), np.empty((count, 3, 3))
    measured = np.isfinite(sequence.positions[:, 0]).tolist()
    stamps = sequence.stamps.tolist()
    began = time.perf_counter()
    for number in range(count):
        if measured[number]:
            state = smoother.step(
                stamps[number], sequence.positions[number], sequence.covariances[number]
            )
        else:
            state = smoother.predict(stamps[number])
        estimates[number] = state.position
        spreads[number] = state.covariance[:3, :3]
    seconds = (time.perf_counter() - began) / count
    return Track(estimates - sequence.truth, spreads, seconds)
