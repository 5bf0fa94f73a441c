"""The paper's cloud-Kalman filter (Sec. 4), literally but for the errata.

Eq. 16's control input is not defined in print. Its reading here is the pull towards the cloud's
expectation, U(k) = Ex(k) - Psi eta(k-1|k-1), and its control parameter Upsilon the certainty of
the predicted position. The paper's Table 6 puts numbers in the certainty's place (``parameter:
constant``): with 1 the mean of the positions so far replaces the prediction, which is best for a
target that keeps still.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.cloud import SlidingCloud, certainty
from binopos_ros.smoothing.kalman import Gaussian, KalmanOptions, estimate, predict, update
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]


@tuned_options('cloud-kalman-paper')
class PaperCloudKalmanOptions(KalmanOptions):
    """Options of the paper's variant."""

    window: int = option(100, 'positions that make up the cloud (Eq. 21-22)', '', (2, 10000))
    hyper_entropy: float = option(1e-4, 'He, a constant (Eq. 23)', 'm', (0.0, 1.0))
    parameter: str = option(
        'certainty',
        'control parameter of Eq. 16: the certainty times control, or control alone',
        choices=('certainty', 'constant'),
    )
    control: float = option(1.0, 'see parameter', '', (-10.0, 10.0))


#: What the state shows at least.
SMALLEST_CERTAINTY = 1e-12


class _Memory(NamedTuple):
    gaussian: Gaussian
    cloud: SlidingCloud
    total: NDArray[np.int64]


#: Standard normal numbers for step (5), the same in every run: (numbers, 3).
_DRAWS = np.random.default_rng(24).standard_normal((1009, 3))


class PaperCloudKalmanFilter(Filter[_Memory]):
    """Kalman filter whose prediction is pulled towards the cloud of the measured positions."""

    name: ClassVar[str] = 'cloud-kalman-paper'
    options_class: ClassVar[type[Options]] = PaperCloudKalmanOptions
    options: PaperCloudKalmanOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        cloud = SlidingCloud.of(position, self.options.window)
        first = self.options.first(position, covariance)
        return _Memory(first, cloud, np.ones(position.shape[:-1], dtype=np.int64))

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        density = self.options.acceleration_density
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        drops = memory.cloud.add(position)
        cloud = drops.cloud()
        state = memory.gaussian.state
        predicted = state[..., :3]
        draws = _DRAWS[memory.total % len(_DRAWS)]
        widths = cloud.entropy + self.options.hyper_entropy * draws
        weight = certainty(predicted, cloud.expectation, widths)
        upsilon = self.options.control * (weight if self.options.parameter == 'certainty' else 1.0)
        pull = np.asarray(upsilon)[..., None] * (cloud.expectation - predicted)
        pulled = np.concatenate([predicted + pull, state[..., 3:]], axis=-1)
        noise = self.options.measurement_covariance(covariance)
        gaussian = update(memory.gaussian._replace(state=pulled), position, noise)
        # A certainty of 0 would say that the position was not used, which the paper never does.
        shown = np.maximum(weight, SMALLEST_CERTAINTY)
        return _Memory(gaussian._replace(certainty=shown), drops, memory.total + 1)

    def _estimate(self, memory: _Memory) -> Estimate:
        return estimate(memory.gaussian)
