"""The moving median of the last positions, axis by axis (Tukey, Exploratory Data Analysis, 1977).

Its covariance is the efficient one of a normal sample's median, pi / 2 S^2 / n, with S from the
median absolute deviation; there is no velocity.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]

_DEVIATION = 1.4826  # of a normal sample over its median absolute deviation
_SPEED_VARIANCE = 1.0


@tuned_options('median')
class MedianOptions(Options):
    """Options of the moving median."""

    window: int = option(9, 'positions that the median is taken of', '', (1, 10000))


class _Memory(NamedTuple):
    """The last positions (..., window, 3), of which the newest `total` (..., 1) are taken."""

    positions: Array
    total: Array
    covariance: Array
    age: Array


class MovingMedian(Filter[_Memory]):
    """The median of the last `window` positions."""

    name: ClassVar[str] = 'median'
    options_class: ClassVar[type[Options]] = MedianOptions
    options: MedianOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        window = np.repeat(position[..., None, :], self.options.window, axis=-2)
        batch = position.shape[:-1]
        return _Memory(window, np.ones((*batch, 1), dtype=int), covariance, np.zeros(batch))

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        return memory._replace(age=np.asarray(elapsed))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        window = np.concatenate([memory.positions[..., 1:, :], position[..., None, :]], axis=-2)
        total = np.minimum(memory.total + 1, self.options.window)
        return _Memory(window, total, covariance, np.zeros(position.shape[:-1]))

    def _estimate(self, memory: _Memory) -> Estimate:
        middle = _median(memory.positions, memory.total)
        apart = np.abs(memory.positions - middle[..., None, :])
        spread = _DEVIATION * _median(apart, memory.total)
        variance = 0.5 * math.pi * spread * spread / memory.total
        variance = variance + _SPEED_VARIANCE * memory.age[..., None] ** 2
        covariance = np.zeros((*middle.shape[:-1], 6, 6))
        covariance[..., :3, :3] = memory.covariance + variance[..., None] * np.eye(3)
        covariance[..., 3:, 3:] = _SPEED_VARIANCE * np.eye(3)
        return Estimate(middle, np.zeros_like(middle), covariance, 1.0)


def _median(values: Array, total: Array) -> Array:
    """Return the medians (..., 3) of the newest `total` (..., 1) rows of values (..., n, 3)."""
    old = np.arange(values.shape[-2]) < values.shape[-2] - total
    ordered = np.sort(np.where(old[..., None], np.inf, values), axis=-2)
    middle = np.stack([(total - 1) // 2, total // 2], axis=-2)
    return np.take_along_axis(ordered, np.repeat(middle, 3, axis=-1), axis=-2).mean(axis=-2)
