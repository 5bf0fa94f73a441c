"""Kalman filter with a random-walk target: position only, no velocity.

Bar-Shalom, Li & Kirubarajan 2001, Sec. 6.2 (a polynomial model of order zero).
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import Gaussian, MeasurementOptions, estimate, update
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]
_POSITION = np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


@tuned_options('kalman-random-walk')
class RandomWalkOptions(MeasurementOptions):
    """Options of the random-walk Kalman filter."""

    walk_density: float = option(
        1e-3, 'growth of the variance of the position', 'm^2/s', (0.0, 1e6)
    )


class RandomWalkKalmanFilter(Filter[Gaussian]):
    """Kalman filter of a target that wanders; its velocity stays 0 +- initial_speed."""

    name: ClassVar[str] = 'kalman-random-walk'
    options_class: ClassVar[type[Options]] = RandomWalkOptions
    options: RandomWalkOptions

    def _start(self, position: Array, covariance: Array) -> Gaussian:
        return self.options.first(position, covariance)

    def _advance(self, memory: Gaussian, elapsed: Seconds) -> Gaussian:
        growth = self.options.walk_density * np.asarray(elapsed)[..., None, None]
        grown = memory.covariance + growth * _POSITION
        return memory._replace(covariance=grown)

    def _correct(self, memory: Gaussian, position: Array, covariance: Array) -> Gaussian:
        noise = self.options.measurement_covariance(covariance)
        return update(memory, position, noise)

    def _estimate(self, memory: Gaussian) -> Estimate:
        return estimate(memory)
