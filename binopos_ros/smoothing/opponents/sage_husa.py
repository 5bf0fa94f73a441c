"""Sage and Husa's adaptive Kalman filter: the measurement noise estimated along the way.

Sage & Husa, "Adaptive filtering with unknown prior statistics", JACC 1969, with the fading weights
d(k) = (1 - b) / (1 - b^(k+1)). Of its four estimates only R's is used, as is usual, since those of
Q and R together are not observable. R's is innovation innovation^T - H P^- H^T, of which the
diagonal is taken and kept above the measurement's own variance, so that R stays positive definite.
Against its well-known divergence, innovations far beyond the expected ones do not change R.
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


@tuned_options('sage-husa')
class SageHusaOptions(KalmanOptions):
    """Options of the Sage-Husa filter; the measurement's options hold at the start."""

    divergence: float = option(
        4.0, 'larger innovations, in expected deviations, do not change R', '', (1.0, 100.0)
    )
    forgetting: float = option(0.97, 'b, the factor on the past per step', '', (0.5, 0.99999))


class _Memory(NamedTuple):
    gaussian: Gaussian
    noise: Array
    fading: Array


class SageHusaFilter(Filter[_Memory]):
    """Constant-velocity Kalman filter that estimates R from its residuals."""

    name: ClassVar[str] = 'sage-husa'
    options_class: ClassVar[type[Options]] = SageHusaOptions
    options: SageHusaOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        first = self.options.first(position, covariance)
        fading = np.full((*position.shape[:-1], 1), self.options.forgetting)
        return _Memory(first, first.covariance[..., :3, :3], fading)

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        density = self.options.acceleration_density
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        fading = memory.fading * self.options.forgetting
        share = (1.0 - self.options.forgetting) / (1.0 - fading)
        gaussian = update(memory.gaussian, position, memory.noise)
        innovation = position - memory.gaussian.state[..., :3]
        seen = innovation * innovation - _diagonal(memory.gaussian.covariance)[..., :3]
        variance = (1.0 - share) * _diagonal(memory.noise) + share * seen
        variance = np.maximum(variance, _diagonal(covariance))
        expected = _diagonal(memory.gaussian.covariance)[..., :3] + _diagonal(memory.noise)
        ratio = (innovation * innovation).sum(axis=-1) / expected.sum(axis=-1)
        trusted = (ratio < self.options.divergence**2)[..., None]
        variance = np.where(trusted, variance, _diagonal(memory.noise))
        return _Memory(gaussian, variance[..., None] * _EYE3, fading)

    def _estimate(self, memory: _Memory) -> Estimate:
        return estimate(memory.gaussian)


def _diagonal(matrices: Array) -> Array:
    return np.diagonal(matrices, axis1=-2, axis2=-1)
