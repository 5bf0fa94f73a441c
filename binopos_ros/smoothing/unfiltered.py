"""No filter: each position stands for itself."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import Gaussian, estimate
from binopos_ros.smoothing.motion import transition, white_acceleration
from binopos_ros.smoothing.state import UNKNOWN_VARIANCE

Array = NDArray[np.float64]

#: How fast an unfiltered position ages where it is predicted: (m/s)^2.
_SPEED_VARIANCE = 1.0


class NoFilter(Filter[Gaussian]):
    """Passes every position on as measured, with its covariance; the velocity is not estimated."""

    name: ClassVar[str] = 'none'

    def _start(self, position: Array, covariance: Array) -> Gaussian:
        spread = np.zeros((6, 6))
        spread[:3, :3] = covariance
        spread[3:, 3:] = _SPEED_VARIANCE * np.eye(3)
        return Gaussian(np.concatenate([position, np.zeros(3)]), spread)

    def _advance(self, memory: Gaussian, elapsed: float) -> Gaussian:
        psi = transition(min(elapsed, UNKNOWN_VARIANCE))
        spread = psi @ memory.covariance @ psi.T + white_acceleration(elapsed, _SPEED_VARIANCE)
        return Gaussian(memory.state, spread)

    def _correct(
        self, memory: Gaussian, position: Array, covariance: Array
    ) -> tuple[Gaussian, str]:
        return self._start(position, covariance), ''

    def _estimate(self, memory: Gaussian) -> Estimate:
        return estimate(memory)
