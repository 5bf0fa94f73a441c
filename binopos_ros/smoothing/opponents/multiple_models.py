"""Interacting multiple models: three constant-velocity filters of different liveliness.

Blom & Bar-Shalom, "The interacting multiple model algorithm for systems with Markovian switching
coefficients", IEEE TAC 33(8), 1988. The switching is a Markov chain in continuous time, so that
irregular stamps keep their meaning.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.kalman import MeasurementOptions
from binopos_ros.smoothing.motion import Seconds, transition, white_acceleration
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]
_MODELS = 3


@tuned_options('imm')
class MultipleModelsOptions(MeasurementOptions):
    """Options of the interacting multiple models."""

    low_density: float = option(
        1e-6, 'acceleration density of the calm model', 'm^2/s^3', (0.0, 1e6)
    )
    middle_density: float = option(
        1e-3, 'acceleration density of the middle model', 'm^2/s^3', (0.0, 1e6)
    )
    high_density: float = option(
        0.1, 'acceleration density of the lively model', 'm^2/s^3', (0.0, 1e6)
    )
    dwell: float = option(1.0, 'mean time in one model', 's', (1e-3, 1e6))


class _Memory(NamedTuple):
    states: Array
    covariances: Array
    weights: Array


class MultipleModelsFilter(Filter[_Memory]):
    """IMM estimator over three process noises."""

    name: ClassVar[str] = 'imm'
    options_class: ClassVar[type[Options]] = MultipleModelsOptions
    options: MultipleModelsOptions

    def _start(self, position: Array, covariance: Array) -> _Memory:
        first = self.options.first(position, covariance)
        return _Memory(
            np.repeat(first.state[..., None, :], _MODELS, axis=-2),
            np.repeat(first.covariance[..., None, :, :], _MODELS, axis=-3),
            np.full((*position.shape[:-1], _MODELS), 1.0 / _MODELS),
        )

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        options = self.options
        stay = np.exp(-np.asarray(elapsed) / options.dwell)[..., None, None]
        switch = np.where(np.eye(_MODELS) > 0, stay, (1.0 - stay) / (_MODELS - 1))
        joint = memory.weights[..., :, None] * switch
        weights = joint.sum(axis=-2)
        mixing = joint / weights[..., None, :]
        states = mixing.swapaxes(-1, -2) @ memory.states
        apart = memory.states[..., :, None, :] - states[..., None, :, :]
        spread = memory.covariances[..., :, None, :, :] + (
            apart[..., :, None] * apart[..., None, :]
        )
        covariances = np.sum(mixing[..., None, None] * spread, axis=-4)
        psi = transition(elapsed)
        back = psi.swapaxes(-1, -2)
        densities = (options.low_density, options.middle_density, options.high_density)
        noise = np.stack([white_acceleration(elapsed, density) for density in densities], axis=-3)
        moved = psi[..., None, :, :] @ covariances @ back[..., None, :, :]
        return _Memory(states @ back, moved + noise, weights)

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        noise = self.options.measurement_covariance(covariance)
        innovation = (position[..., None, :] - memory.states[..., :3])[..., None]
        cross = memory.covariances[..., :3]
        expected = cross[..., :3, :] + noise[..., None, :, :]
        inverse = np.linalg.inv(expected)
        gain = cross @ inverse
        states = memory.states + (gain @ innovation)[..., 0]
        covariances = memory.covariances - gain @ cross.swapaxes(-1, -2)
        covariances = 0.5 * (covariances + covariances.swapaxes(-1, -2))
        logarithm = -0.5 * np.sum(innovation * (inverse @ innovation), axis=(-2, -1))
        logarithm -= 0.5 * np.log(np.linalg.det(expected))
        logarithm -= logarithm.max(axis=-1, keepdims=True)
        weights = memory.weights * np.exp(logarithm) + 1e-12
        return _Memory(states, covariances, weights / weights.sum(axis=-1, keepdims=True))

    def _estimate(self, memory: _Memory) -> Estimate:
        state = np.sum(memory.weights[..., None] * memory.states, axis=-2)
        apart = memory.states - state[..., None, :]
        spread = memory.covariances + apart[..., :, None] * apart[..., None, :]
        covariance = np.sum(memory.weights[..., None, None] * spread, axis=-3)
        return Estimate(state[..., :3], state[..., 3:], covariance, 1.0)
