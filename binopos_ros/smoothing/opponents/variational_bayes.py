"""Variational-Bayes adaptive Kalman filter: state and noise variances estimated together.

Sarkka & Nummenmaa, "Recursive noise adaptive Kalman filtering by variational Bayesian
approximations", IEEE TAC 54(3), 2009: inverse-gamma variances of R's diagonal, which spread by the
factor rho per step, and a few fixed-point iterations.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import Gaussian, KalmanOptions, estimate, predict, update
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]
_EYE3 = np.eye(3)
_ITERATIONS = 3


@tuned_options('variational-bayes')
class VariationalBayesOptions(KalmanOptions):
    """Options of the variational-Bayes filter; the measurement's options hold at the start."""

    spreading: float = option(0.97, 'rho: 1 holds the noise constant', '', (0.5, 1.0))


class _Memory(NamedTuple):
    gaussian: Gaussian
    shape: Array
    scale: Array


class VariationalBayesFilter(Filter[_Memory]):
    """Constant-velocity Kalman filter with unknown, changing measurement variances."""

    name: ClassVar[str] = 'variational-bayes'
    options_class: ClassVar[type[Options]] = VariationalBayesOptions
    options: VariationalBayesOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        first = self.options.first(position, covariance)
        scale = np.diagonal(first.covariance, axis1=-2, axis2=-1)[..., :3]
        return _Memory(first, np.ones((*position.shape[:-1], 1)), scale)

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        density = self.options.acceleration_density
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        shape = self.options.spreading * memory.shape + 0.5
        prior_scale = self.options.spreading * memory.scale
        scale = prior_scale + 0.5 * memory.scale / memory.shape
        for _ in range(_ITERATIONS):
            gaussian = update(memory.gaussian, position, (scale / shape)[..., None] * _EYE3)
            residual = position - gaussian.state[..., :3]
            scale = prior_scale + 0.5 * (
                residual * residual + np.diagonal(gaussian.covariance, axis1=-2, axis2=-1)[..., :3]
            )
        return _Memory(gaussian, shape, scale)

    def _estimate(self, memory: _Memory) -> Estimate:
        return estimate(memory.gaussian)
