"""Kalman filter with Huber's M-estimation of the measurement's share.

Karlgaard & Schaub, "Huber-based divided difference filtering", J. Guid. Control Dyn. 30(3), 2007:
the update as a regression whose whitened residuals e weigh min(1, gamma / |e|), reweighted a few
times. Only the measurement's rows are reweighted, not the prediction's.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.kalman import Gaussian, KalmanFilter, KalmanOptions, update
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]
_ITERATIONS = 3


@tuned_options('huber')
class HuberOptions(KalmanOptions):
    """Options of the Huber-Kalman filter."""

    threshold: float = option(1.345, 'gamma: larger residuals weigh less', '', (0.1, 100.0))


class HuberKalmanFilter(KalmanFilter):
    """Constant-velocity Kalman filter robust to outliers by Huber's weights."""

    name: ClassVar[str] = 'huber'
    options_class: ClassVar[type[Options]] = HuberOptions
    options: HuberOptions

    def _correct(self, memory: Gaussian, position: Array, covariance: Array) -> Gaussian:
        root = np.linalg.cholesky(self.options.measurement_covariance(covariance))
        whiten = np.linalg.inv(root)
        corrected = memory
        for _ in range(_ITERATIONS):
            residual = np.abs(whiten @ (position - corrected.state[..., :3])[..., None])[..., 0]
            weight = np.minimum(1.0, self.options.threshold / np.maximum(residual, 1e-12))
            corrected = update(
                memory, position, (root / weight[..., None, :]) @ root.swapaxes(-1, -2)
            )
        return corrected._replace(certainty=weight.min(axis=-1))
