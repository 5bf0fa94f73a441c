"""Student's t filter: the Kalman filter's recursion for heavy-tailed noise.

Roth, Ozkan & Gustafsson, "A Student's t filter for heavy tailed process and measurement noise",
ICASSP 2013: the posterior's scale matrix grows with the innovation,
P = (nu + d^2) / (nu + m) (P^- - K S K^T), and the degrees of freedom are held at nu.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate
from binopos_ros.smoothing.kalman import Gaussian, KalmanFilter, KalmanOptions, estimate, update
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]


@tuned_options('student-t')
class StudentTOptions(KalmanOptions):
    """Options of the Student-t filter; its matrices are scale matrices, not covariances."""

    freedom: float = option(5.0, 'nu, degrees of freedom', '', (2.1, 1e4))


class StudentTFilter(KalmanFilter):
    """Constant-velocity filter with Student-t noises of common degrees of freedom."""

    name: ClassVar[str] = 'student-t'
    options_class: ClassVar[type[Options]] = StudentTOptions
    options: StudentTOptions

    def _correct(self, memory: Gaussian, position: Array, covariance: Array) -> Gaussian:
        noise = self.options.measurement_covariance(covariance)
        innovation = (position - memory.state[..., :3])[..., None]
        solved = np.linalg.solve(memory.covariance[..., :3, :3] + noise, innovation)
        squared = np.sum(innovation * solved, axis=(-2, -1))
        freedom = self.options.freedom
        growth = (freedom + squared) / (freedom + 3.0)
        corrected = update(memory, position, noise)
        grown = growth[..., None, None] * corrected.covariance
        return Gaussian(corrected.state, grown, 1.0 / np.maximum(growth, 1.0))

    def _estimate(self, memory: Gaussian) -> Estimate:
        spread = self.options.freedom / (self.options.freedom - 2.0) * memory.covariance
        return estimate(memory._replace(covariance=spread))
