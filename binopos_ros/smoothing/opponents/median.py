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
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]

_DEVIATION = 1.4826  # of a normal sample over its median absolute deviation
_SPEED_VARIANCE = 1.0


@tuned_options('median')
class MedianOptions(Options):
    """Options of the moving median."""

    window: int = option(9, 'positions that the median is taken of', '', (1, 10000))


class _Memory(NamedTuple):
    positions: Array
    covariance: Array
    age: float


class MovingMedian(Filter[_Memory]):
    """The median of the last `window` positions."""

    name: ClassVar[str] = 'median'
    options_class: ClassVar[type[Options]] = MedianOptions
    options: MedianOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        return _Memory(position[None], covariance, 0.0)

    def _advance(self, memory: _Memory, elapsed: float) -> _Memory:
        return memory._replace(age=elapsed)

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> tuple[_Memory, str]:
        positions = np.concatenate([memory.positions, position[None]])
        return _Memory(positions[-self.options.window :], covariance, 0.0), ''

    def _estimate(self, memory: _Memory) -> Estimate:
        middle = np.median(memory.positions, axis=0)
        spread = _DEVIATION * np.median(np.abs(memory.positions - middle), axis=0)
        covariance = _SPEED_VARIANCE * np.eye(6)
        covariance[:3, :3] = memory.covariance + np.diag(
            0.5 * math.pi * spread * spread / len(memory.positions)
            + _SPEED_VARIANCE * memory.age**2
        )
        return Estimate(middle, np.zeros(3), covariance, 1.0)
