"""Kalman filter with coloured measurement noise: an autoregressive process of second order.

Bryson & Henrikson, "Estimation using sampled data containing sequentially correlated noise",
J. Spacecraft 5(6), 1968, in the augmented form: the state holds the noise too, here the position
and velocity of a damped oscillator per axis (an AR(2) when sampled evenly). Its frequency, damping
and spread are constants.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import KalmanOptions
from binopos_ros.smoothing.motion import Seconds, transition, white_acceleration
from binopos_ros.smoothing.options import Options, option, tuned_options
from binopos_ros.smoothing.wave import oscillator

Array = NDArray[np.float64]
_EYE3 = np.eye(3)


@tuned_options('coloured-noise')
class ColouredOptions(KalmanOptions):
    """Options of the coloured-noise filter; the measurement's options make the coloured part."""

    frequency: float = option(2.5, 'natural frequency of the noise', 'Hz', (0.1, 100.0))
    damping: float = option(0.3, 'damping ratio of the noise', '', (0.01, 0.99))


class _Memory(NamedTuple):
    """State (12,): position, velocity, noise, the noise's rate; the noise's own covariance."""

    state: Array
    covariance: Array
    coloured: Array


class ColouredNoiseFilter(Filter[_Memory]):
    """Constant-velocity Kalman filter that knows its noise to be a damped oscillation."""

    name: ClassVar[str] = 'coloured-noise'
    options_class: ClassVar[type[Options]] = ColouredOptions
    options: ColouredOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        coloured = self.options.measurement_covariance(covariance)
        batch = position.shape[:-1]
        spread = np.zeros((*batch, 12, 12))
        spread[..., :3, :3] = covariance + coloured
        spread[..., 3:6, 3:6] = self.options.initial_speed**2 * _EYE3
        spread[..., 6:9, 6:9] = spread[..., 9:, 9:] = coloured
        spread[..., :3, 6:9] = spread[..., 6:9, :3] = -coloured
        state = np.concatenate([position, np.zeros((*batch, 9))], axis=-1)
        return _Memory(state, spread, coloured)

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        options = self.options
        batch = memory.state.shape[:-1]
        phi = np.zeros((*batch, 12, 12))
        phi[..., :6, :6] = transition(elapsed)
        small = oscillator(2.0 * math.pi * options.frequency, options.damping, elapsed)
        phi[..., 6:, 6:] = _blocks(small, _EYE3)
        # The noise is stationary with its covariance, from which its driving noise follows.
        noise = np.zeros((*batch, 12, 12))
        noise[..., :6, :6] = white_acceleration(elapsed, options.acceleration_density)
        driven = np.eye(2) - small @ small.swapaxes(-1, -2)
        noise[..., 6:, 6:] = _blocks(driven, memory.coloured)
        covariance = phi @ memory.covariance @ phi.swapaxes(-1, -2) + noise
        return _Memory((phi @ memory.state[..., None])[..., 0], covariance, memory.coloured)

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        cross = memory.covariance[..., :3] + memory.covariance[..., 6:9]
        gain = cross @ np.linalg.inv(cross[..., :3, :] + cross[..., 6:9, :] + covariance)
        innovation = position - memory.state[..., :3] - memory.state[..., 6:9]
        state = memory.state + (gain @ innovation[..., None])[..., 0]
        corrected = memory.covariance - gain @ cross.swapaxes(-1, -2)
        coloured = self.options.measurement_covariance(covariance)
        return _Memory(state, 0.5 * (corrected + corrected.swapaxes(-1, -2)), coloured)

    def _estimate(self, memory: _Memory) -> Estimate:
        return Estimate(
            memory.state[..., :3], memory.state[..., 3:6], memory.covariance[..., :6, :6], 1.0
        )


def _blocks(small: Array, block: Array) -> Array:
    """Return the Kronecker products (..., 6, 6) of (..., 2, 2) and (..., 3, 3) matrices."""
    product = small[..., :, None, :, None] * block[..., None, :, None, :]
    return product.reshape(*product.shape[:-4], 6, 6)
