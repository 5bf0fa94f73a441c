"""The paper's cloud-Kalman filter (Sec. 4), literally but for the errata.

Eq. 16's control input is not defined in print. Its reading here is the pull towards the
cloud's expectation, U(k) = Ex(k) - Psi eta(k-1|k-1), and its parameter the certainty of the
predicted position times `control`: a control of 1 replaces the prediction of a certain position by
the mean of the positions so far, which explains the paper's Table 6.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.cloud import SlidingCloud, certainty
from binopos_ros.smoothing.kalman import Gaussian, KalmanOptions, estimate, predict, update
from binopos_ros.smoothing.options import Options, option, tuned_options
from binopos_ros.smoothing.state import FilterState

Array = NDArray[np.float64]


@tuned_options('cloud-kalman-paper')
class PaperCloudKalmanOptions(KalmanOptions):
    """Options of the paper's variant."""

    window: int = option(100, 'positions that make up the cloud (Eq. 21-22)', '', (2, 10000))
    hyper_entropy: float = option(1e-4, 'He, a constant (Eq. 23)', 'm', (0.0, 1.0))
    control: float = option(1.0, 'factor on the certainty as control parameter', '', (-10.0, 10.0))


class _Memory(NamedTuple):
    gaussian: Gaussian
    cloud: SlidingCloud
    total: int


class PaperCloudKalmanFilter(Filter[_Memory]):
    """Kalman filter whose prediction is pulled towards the cloud of the measured positions."""

    name: ClassVar[str] = 'cloud-kalman-paper'
    options_class: ClassVar[type[Options]] = PaperCloudKalmanOptions
    options: PaperCloudKalmanOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        cloud = SlidingCloud.empty(self.options.window).add(position)
        return _Memory(self.options.first(position, covariance), cloud, 1)

    def _advance(self, memory: _Memory, elapsed: float) -> _Memory:
        density = self.options.acceleration_density
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> tuple[_Memory, str]:
        drops = memory.cloud.add(position)
        cloud = drops.cloud()
        state = memory.gaussian.state
        # Seeded by the position's number: the draw of step (5), the same in every run.
        random = np.random.default_rng(memory.total)
        widths = random.normal(cloud.entropy, self.options.hyper_entropy)
        weight = float(certainty(state[:3], cloud.expectation, widths))
        pull = self.options.control * weight * (cloud.expectation - state[:3])
        pulled = memory.gaussian._replace(
            state=np.concatenate([state[:3] + pull, state[3:]]), certainty=weight
        )
        noise = self.options.measurement_covariance(covariance)
        return _Memory(update(pulled, position, noise), drops, memory.total + 1), ''

    def _estimate(self, memory: _Memory) -> Estimate:
        return estimate(memory.gaussian)


def most_certain(states: Iterable[FilterState]) -> FilterState:
    """Return the state with the largest certainty: step (7) of Sec. 4.2, its erratum mended."""
    return max(states, key=lambda state: state.certainty)
