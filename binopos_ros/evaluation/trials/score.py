"""Filters run over sequences, and what comes of it."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence as Series
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Filter

Array = NDArray[np.float64]

#: Frames at the start that no score counts: one second, in which a filter finds its feet.
SETTLING = 30


class Trial(Protocol):
    """What was measured of a target in n frames; `Sequence` is one.

    Positions (n, 3) are nan where the frame gave none; `media` (n, 3, 3) is None where nothing
    can wave.
    """

    @property
    def stamps(self) -> Array: ...
    @property
    def truth(self) -> Array: ...
    @property
    def positions(self) -> Array: ...
    @property
    def covariances(self) -> Array: ...
    @property
    def media(self) -> Array | None: ...


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


def run_together(smoother: Filter[Any], trials: Series[Trial]) -> list[Track]:
    """Run a filter over sequences of equal length in lock-step: for tuning.

    The same as :func:`run` on each, but for the shell's starting afresh after a long gap or a run
    of refused positions, and much faster.
    """
    stamps = np.stack([trial.stamps for trial in trials])
    positions = np.stack([trial.positions for trial in trials])
    parts = [trial.media for trial in trials if trial.media is not None]
    media = np.stack(parts) if parts else None
    covariances = np.stack([trial.covariances for trial in trials])
    if media is not None:
        covariances = covariances + media

    def spread(covariance: Array, number: int) -> Array:
        return smoother.spread(covariance, None if media is None else media[:, number])

    truth = np.stack([trial.truth for trial in trials])
    options = smoother.options
    memory = smoother._start(positions[:, 0], spread(covariances[:, 0], 0))
    estimates, spreads = np.empty_like(positions), np.empty_like(covariances)
    at = stamps[:, 0]
    began = time.perf_counter()
    for number in range(stamps.shape[1]):
        if number > 0:
            elapsed = stamps[:, number] - at
            measured = np.isfinite(positions[:, number, 0])
            position = np.where(measured[:, None], positions[:, number], 0.0)
            covariance = np.where(measured[:, None, None], covariances[:, number], np.eye(3))
            covariance = spread(covariance, number)
            ahead = smoother._advance(memory, elapsed)
            foretold = smoother._estimate(ahead)
            distance = np.linalg.norm(position - foretold.position, axis=1)
            used = measured & (distance <= options.max_jump + options.max_speed * elapsed)
            corrected = smoother._correct(ahead, position, covariance)
            # As in the shell, a frame without a usable position leaves the memory as it was.
            memory = _select(used, corrected, memory)
            at = np.where(used, stamps[:, number], at)
            said = _select(used, smoother._estimate(corrected), foretold)
        else:
            said = smoother._estimate(memory)
        estimates[:, number] = said.position
        spreads[:, number] = said.covariance[:, :3, :3]
    seconds = (time.perf_counter() - began) / stamps.size
    return [
        Track(error, spread, seconds)
        for error, spread in zip(estimates - truth, spreads, strict=True)
    ]


def _select(used: NDArray[np.bool_], new: Any, old: Any) -> Any:
    """Return `new` where used, else `old`: arrays with a leading batch, or tuples of such."""
    if new is None or old is None:
        return new
    if isinstance(new, tuple):
        return type(new)(*(_select(used, *pair) for pair in zip(new, old, strict=True)))
    new, old = np.asarray(new), np.asarray(old)
    if new.ndim == 0:
        return new
    return np.where(used.reshape(-1, *([1] * (new.ndim - 1))), new, old)


def run(smoother: Filter[Any], sequence: Trial) -> Track:
    """Run a filter, started afresh, over a sequence."""
    smoother.reset()
    count = sequence.stamps.size
    estimates, spreads = np.empty((count, 3)), np.empty((count, 3, 3))
    measured = np.isfinite(sequence.positions[:, 0]).tolist()
    stamps = sequence.stamps.tolist()
    began = time.perf_counter()
    for number in range(count):
        if measured[number]:
            medium = None if sequence.media is None else sequence.media[number]
            covariance = sequence.covariances[number]
            state = smoother.step(
                stamps[number],
                sequence.positions[number],
                covariance if medium is None else covariance + medium,
                medium,
            )
        else:
            state = smoother.predict(stamps[number])
        estimates[number] = state.position
        spreads[number] = state.covariance[:3, :3]
    seconds = (time.perf_counter() - began) / count
    return Track(estimates - sequence.truth, spreads, seconds)
