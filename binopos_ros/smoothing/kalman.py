"""The Kalman filter (paper Eq. 16-20, errata mended), with two motion models.

Eq. 17 is P(k|k-1) = Psi P(k-1|k-1) Psi^T + Q; Eq. 18 is the state's, Eq. 20 the covariance's.
"""

from __future__ import annotations

import dataclasses
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.motion import Seconds, transition, white_acceleration
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]
_EYE3 = np.eye(3)


class Gaussian(NamedTuple):
    """State (..., 6): position and velocity (m, m/s); its covariance (..., 6, 6); last weight."""

    state: Array
    covariance: Array
    certainty: Array | float = 1.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeasurementOptions(Options):
    """How the covariance given with a measurement becomes R (Eq. 19)."""

    measurement_scale: float = option(
        1.0, 'factor on the covariance given with a measurement', '', (1e-3, 1e6)
    )
    measurement_std: float = option(
        0.0, 'standard deviation added in every direction', 'm', (0.0, 10.0)
    )
    initial_speed: float = option(
        0.1, 'standard deviation of the velocity at the start', 'm/s', (1e-6, 100.0)
    )

    def measurement_covariance(self, covariance: Array) -> Array:
        """Return R (..., 3, 3), m^2, for a measurement of that covariance."""
        return self.measurement_scale * covariance + self.measurement_std**2 * _EYE3

    def first(self, position: Array, covariance: Array) -> Gaussian:
        """Return the Gaussian that a first measurement leaves: its position, no velocity."""
        spread = np.zeros((*position.shape[:-1], 6, 6))
        spread[..., :3, :3] = self.measurement_covariance(covariance)
        spread[..., 3:, 3:] = self.initial_speed**2 * _EYE3
        return Gaussian(np.concatenate([position, np.zeros_like(position)], axis=-1), spread)


@tuned_options('kalman')
class KalmanOptions(MeasurementOptions):
    """Options of the constant-velocity Kalman filter."""

    acceleration_density: float = option(
        1e-2,
        'power density of the white acceleration that drives the target',
        'm^2/s^3',
        (0.0, 1e6),
    )


def predict(gaussian: Gaussian, elapsed: Seconds, density: float) -> Gaussian:
    """Return the Gaussian `elapsed` seconds later (Eq. 16-17 without a control input)."""
    psi = transition(elapsed)
    covariance = psi @ gaussian.covariance @ psi.swapaxes(-1, -2)
    state = (psi @ gaussian.state[..., None])[..., 0]
    return Gaussian(state, covariance + white_acceleration(elapsed, density))


def update(gaussian: Gaussian, position: Array, noise: Array) -> Gaussian:
    """Return the Gaussian after a measured position (..., 3) with R = `noise` (..., 3, 3)."""
    state, covariance = gaussian.state, gaussian.covariance
    cross = covariance[..., :3]
    gain = cross @ np.linalg.inv(cross[..., :3, :] + noise)
    corrected = covariance - gain @ cross.swapaxes(-1, -2)
    return Gaussian(
        state + (gain @ (position - state[..., :3])[..., None])[..., 0],
        0.5 * (corrected + corrected.swapaxes(-1, -2)),
    )


def estimate(gaussian: Gaussian) -> Estimate:
    """Return a Gaussian as the shell's estimate."""
    state = gaussian.state
    return Estimate(state[..., :3], state[..., 3:], gaussian.covariance, gaussian.certainty)


class KalmanFilter(Filter[Gaussian]):
    """Constant-velocity Kalman filter: the textbook's, whatever the waves do."""

    name: ClassVar[str] = 'kalman'
    options_class: ClassVar[type[Options]] = KalmanOptions
    options: KalmanOptions

    def _start(self, position: Array, covariance: Array) -> Gaussian:
        return self.options.first(position, covariance)

    def _advance(self, memory: Gaussian, elapsed: Seconds) -> Gaussian:
        return predict(memory, elapsed, self.options.acceleration_density)

    def _correct(self, memory: Gaussian, position: Array, covariance: Array) -> Gaussian:
        noise = self.options.measurement_covariance(covariance)
        return update(memory, position, noise)

    def _estimate(self, memory: Gaussian) -> Estimate:
        return estimate(memory)
