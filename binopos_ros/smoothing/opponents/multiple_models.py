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
from binopos_ros.smoothing.motion import transition, white_acceleration
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
            np.tile(first.state, (_MODELS, 1)),
            np.tile(first.covariance, (_MODELS, 1, 1)),
            np.full(_MODELS, 1.0 / _MODELS),
        )

    def _advance(self, memory: _Memory, elapsed: float) -> _Memory:
        options = self.options
        stay = np.exp(-elapsed / options.dwell)
        switch = (1.0 - stay) / (_MODELS - 1) * np.ones((_MODELS, _MODELS))
        np.fill_diagonal(switch, stay)
        weights = memory.weights @ switch
        mixing = switch * memory.weights[:, None] / weights
        states = mixing.T @ memory.states
        apart = memory.states[:, None] - states[None]
        spread = memory.covariances[:, None] + apart[..., :, None] * apart[..., None, :]
        covariances = np.einsum('ij,ijab->jab', mixing, spread)
        psi = transition(elapsed)
        densities = (options.low_density, options.middle_density, options.high_density)
        noise = np.stack([white_acceleration(elapsed, density) for density in densities])
        return _Memory(states @ psi.T, psi @ covariances @ psi.T + noise, weights)

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> tuple[_Memory, str]:
        noise = self.options.measurement_covariance(covariance)
        innovation = position - memory.states[:, :3]
        cross = memory.covariances[:, :, :3]
        expected = cross[:, :3] + noise
        inverse = np.linalg.inv(expected)
        solved = (inverse @ innovation[:, :, None])[:, :, 0]
        gain = cross @ inverse
        states = memory.states + (gain @ innovation[:, :, None])[:, :, 0]
        covariances = memory.covariances - gain @ cross.transpose(0, 2, 1)
        covariances = 0.5 * (covariances + covariances.transpose(0, 2, 1))
        logarithm = -0.5 * np.sum(innovation * solved, axis=1)
        logarithm -= 0.5 * np.log(np.linalg.det(expected))
        weights = memory.weights * np.exp(logarithm - logarithm.max()) + 1e-12
        return _Memory(states, covariances, weights / weights.sum()), ''

    def _estimate(self, memory: _Memory) -> Estimate:
        state = memory.weights @ memory.states
        apart = memory.states - state
        covariance = np.tensordot(memory.weights, memory.covariances, 1)
        covariance += (apart * memory.weights[:, None]).T @ apart
        return Estimate(state[:3], state[3:], covariance, 1.0)
