"""Sage and Husa's adaptive Kalman filter: the measurement noise estimated along the way.

Sage & Husa, "Adaptive filtering with unknown prior statistics", JACC 1969, with the fading weights
d(k) = (1 - b) / (1 - b^(k+1)). Of its four estimates only R's is used, as is usual, since those of
Q and R together are not observable; and R's in the form that stays positive definite,
residual residual^T + H P H^T, instead of innovation innovation^T - H P H^T.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import Gaussian, KalmanOptions, estimate, predict, update
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]


@tuned_options('sage-husa')
class SageHusaOptions(KalmanOptions):
    """Options of the Sage-Husa filter; the measurement's options hold at the start."""

    forgetting: float = option(0.97, 'b, the factor on the past per step', '', (0.5, 0.99999))


class _Memory(NamedTuple):
    gaussian: Gaussian
    noise: Array
    fading: float


class SageHusaFilter(Filter[_Memory]):
    """Constant-velocity Kalman filter that estimates R from its residuals."""

    name: ClassVar[str] = 'sage-husa'
    options_class: ClassVar[type[Options]] = SageHusaOptions
    options: SageHusaOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        first = self.options.first(position, covariance)
        return _Memory(first, first.covariance[:3, :3], self.options.forgetting)

    def _advance(self, memory: _Memory, elapsed: float) -> _Memory:
        density = self.options.acceleration_density
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> tuple[_Memory, str]:
        fading = memory.fading * self.options.forgetting
        share = (1.0 - self.options.forgetting) / (1.0 - fading)
        gaussian = update(memory.gaussian, position, memory.noise)
        residual = position - gaussian.state[:3]
        seen = np.outer(residual, residual) + gaussian.covariance[:3, :3]
        return _Memory(gaussian, (1.0 - share) * memory.noise + share * seen, fading), ''

    def _estimate(self, memory: _Memory) -> Estimate:
        return estimate(memory.gaussian)
