"""No filter: each position stands for itself."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import Gaussian, estimate
from binopos_ros.smoothing.motion import Seconds, transition, white_acceleration

Array = NDArray[np.float64]

#: How fast an unfiltered position ages where it is predicted: (m/s)^2.
_SPEED_VARIANCE = 1.0


class NoFilter(Filter[Gaussian]):
    """Passes every position on as measured, with its covariance; the velocity is not estimated."""

    name: ClassVar[str] = 'none'

    def _start(self, position: Array, covariance: Array) -> Gaussian:
        spread = np.zeros((*position.shape[:-1], 6, 6))
        spread[..., :3, :3] = covariance
        spread[..., 3:, 3:] = _SPEED_VARIANCE * np.eye(3)
        return Gaussian(np.concatenate([position, np.zeros_like(position)], axis=-1), spread)

    def _advance(self, memory: Gaussian, elapsed: Seconds) -> Gaussian:
        psi = transition(elapsed)
        spread = psi @ memory.covariance @ psi.swapaxes(-1, -2)
        return Gaussian(memory.state, spread + white_acceleration(elapsed, _SPEED_VARIANCE))

    def _correct(self, memory: Gaussian, position: Array, covariance: Array) -> Gaussian:
        return self._start(position, covariance)

    def _estimate(self, memory: Gaussian) -> Estimate:
        return estimate(memory)
