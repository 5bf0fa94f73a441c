"""BP-Kalman: a small back-propagation network that corrects a Kalman filter's estimate.

The paper names this opponent without defining it. Of the definitions in use the commonest is
taken: the filter runs as it is, and a feed-forward network, trained by back-propagation
(Rumelhart, Hinton & Williams, Nature 323, 1986) on sequences with known truth, maps what the
filter just saw to the error of its estimate, which is taken off. The correction is not fed back
into the filter, so the network cannot make it diverge. Inputs, one axis at a time with the same
weights for all three, in units of the innovation's expected deviation: the last innovations and
the velocity.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import Gaussian, KalmanOptions, estimate, predict, update
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.opponents.bp_weights import HIDDEN, HIDDEN_BIAS, OUTPUT, OUTPUT_BIAS
from binopos_ros.smoothing.options import Options, tuned_options

Array = NDArray[np.float64]

#: Innovations that the network sees.
INNOVATIONS = 6
#: Inputs beyond this many deviations say no more.
LARGEST_INPUT = 4.0
_VELOCITY_TIME = 0.1


@tuned_options('bp-kalman')
class BackPropagationOptions(KalmanOptions):
    """Options of the Kalman filter that the network was trained on."""


class Network(NamedTuple):
    """Inputs (n, INNOVATIONS + 1) to tanh units to one number (n,)."""

    hidden: Array
    hidden_bias: Array
    output: Array
    output_bias: float

    def __call__(self, inputs: Array) -> Array:
        """Return the correction for each row of inputs."""
        return np.tanh(inputs @ self.hidden + self.hidden_bias) @ self.output + self.output_bias


class _Memory(NamedTuple):
    gaussian: Gaussian
    innovations: Array
    correction: Array


class BackPropagationKalmanFilter(Filter[_Memory]):
    """Constant-velocity Kalman filter with a network's correction on top."""

    name: ClassVar[str] = 'bp-kalman'
    options_class: ClassVar[type[Options]] = BackPropagationOptions
    options: BackPropagationOptions
    network = Network(np.array(HIDDEN), np.array(HIDDEN_BIAS), np.array(OUTPUT), OUTPUT_BIAS)

    def _start(self, position: Array, covariance: Array) -> _Memory:
        first = self.options.first(position, covariance)
        return _Memory(first, np.zeros((*position.shape, INNOVATIONS)), np.zeros_like(position))

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        density = self.options.acceleration_density
        return memory._replace(gaussian=predict(memory.gaussian, elapsed, density))

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        noise = self.options.measurement_covariance(covariance)
        inputs, innovations, deviation = features(
            memory.gaussian, memory.innovations, position, noise
        )
        gaussian = update(memory.gaussian, position, noise)
        return _Memory(gaussian, innovations, self.network(inputs) * deviation)

    def _estimate(self, memory: _Memory) -> Estimate:
        plain = estimate(memory.gaussian)
        return plain._replace(position=plain.position + memory.correction)


def features(
    predicted: Gaussian, innovations: Array, position: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """Return the network's inputs (..., 3, k), the shifted innovations, their deviations."""
    expected = predicted.covariance[..., :3, :3] + noise
    deviation = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
    newest = (position - predicted.state[..., :3]) / deviation
    innovations = np.concatenate([newest[..., None], innovations[..., :-1]], axis=-1)
    velocity = _VELOCITY_TIME * predicted.state[..., 3:] / deviation
    inputs = np.concatenate([innovations, velocity[..., None]], axis=-1)
    return np.clip(inputs, -LARGEST_INPUT, LARGEST_INPUT), innovations, deviation
