"""The default smoother: a bank of Kalman filters steered by the cloud of innovations."""

from __future__ import annotations

import dataclasses
import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.cloud import RecursiveCloud, certainty
from binopos_ros.smoothing.kalman import Gaussian, estimate, predict, update
from binopos_ros.smoothing.options import Options, option

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True, kw_only=True)
class CloudKalmanOptions(Options):
    """Options of the default smoother."""

    window: float = option(15.0, 'innovations that make up the cloud', '', (2.0, 1e4))
    quiet_density: float = option(
        1e-3, 'power density of the acceleration of a calm target', 'm^2/s^3', (0.0, 1e6)
    )
    initial_speed: float = option(
        0.1, 'standard deviation of the velocity at the start', 'm/s', (1e-6, 100.0)
    )


class _Memory(NamedTuple):
    gaussian: Gaussian
    cloud: RecursiveCloud
    density: float


class CloudKalmanFilter(Filter[_Memory]):
    """Kalman filter whose noises follow the cloud of its innovations."""

    name: ClassVar[str] = 'cloud-kalman'
    options_class: ClassVar[type[Options]] = CloudKalmanOptions
    options: CloudKalmanOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        spread = np.zeros((6, 6))
        spread[:3, :3] = covariance
        spread[3:, 3:] = self.options.initial_speed**2 * np.eye(3)
        state = np.concatenate([position, np.zeros(3)])
        cloud = RecursiveCloud.empty(self.options.window)
        return _Memory(Gaussian(state, spread), cloud, self.options.quiet_density)

    def _advance(self, memory: _Memory, elapsed: float) -> _Memory:
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, memory.density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> tuple[_Memory, str]:
        innovation = position - memory.gaussian.state[:3]
        before = memory.cloud.cloud()
        noise = covariance
        weight = 1.0
        if memory.cloud.total > 3:
            own = np.diagonal(covariance) + np.diagonal(memory.gaussian.covariance)[:3]
            widths = np.sqrt(before.entropy**2 + before.hyper_entropy**2 + own)
            weight = float(certainty(innovation / 3.0, before.expectation / 3.0, widths))
            noise = (covariance + np.diag(before.entropy**2)) / max(weight, 1e-4)
        drops = memory.cloud.add(math.sqrt(weight) * innovation)
        cloud = drops.cloud()
        lag = float(np.sum(cloud.expectation**2) / (np.sum(cloud.entropy**2) + 1e-12))
        density = self.options.quiet_density * (1.0 + 10.0 * lag)
        gaussian = update(memory.gaussian._replace(certainty=weight), position, noise)
        return _Memory(gaussian, drops, density), ''

    def _estimate(self, memory: _Memory) -> Estimate:
        return estimate(memory.gaussian)
