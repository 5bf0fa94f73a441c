"""The default smoother: a bank of Kalman filters steered by the cloud of its innovations.

The paper's idea is kept: a cloud model says how the measured positions scatter, and its certainty
controls the Kalman filter. Changed is what makes it work for a target that moves:

* the cloud's drops are what is left of the measured positions once the target's filtered position
  is taken off, not the positions themselves;
* its expectation is a lag: the control input of the turning hypothesis (Eq. 16), as far as it
  stands out of its own uncertainty;
* its entropy is the waves' present spread, its square less the measurement's own variance their
  variance;
* its hyper-entropy says how far that spread can be trusted: it widens the certainty;
* its certainty (Eq. 24) weighs each measurement: Welsch's weight exp(-(d / width)^2 / 2) of robust
  statistics (Dennis & Welsch, Commun. Stat. Simul. Comput. 7(4), 1978);
* a run of positions with little certainty shakes the trust in the filter itself, and widens the
  certainty until it takes them;
* calm water is a hypothesis of its own: the measurement's covariance then says it all;
* the waves' motion is an oscillation in the state (:mod:`binopos_ros.smoothing.wave`), and the
  target's one of three kinds (:mod:`binopos_ros.smoothing.bank`), along and across the line of
  sight, where waves and pixels err very differently.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.bank import (
    TURNING,
    Bank,
    Hypotheses,
    Motion,
    P,
    innovations,
    mean_position,
    moments,
    update,
)
from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.cloud import RecursiveCloud
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option, tuned_options

Array = NDArray[np.float64]

#: Positions with less certainty than this are not used, and the state says so.
_LEAST_CERTAINTY = 1e-8
#: Drops that the assumed wave height at the start counts for.
_DROPS_AT_START = 10.0
#: The axes follow the line of sight once its direction is off by half a degree: tangent.
_TURNED = math.tan(math.radians(0.5))
#: Sums over the axes as products: far cheaper than sum() on arrays as small as these.
_AXES = np.ones((3, 1))
_ACROSS = np.array([[0.5], [0.5], [0.0]])
#: Share of the newest certainty in the trust: wrong detections seldom come in a row.
_FORGETTING = 0.3
#: Trust in the filter at the start: it has yet to be earned, and a quick target must be taken.
_FIRST_TRUST = 0.3
#: Less than this share of the deviation at the start is no wave: that is the calm hypotheses'. So
#: waves that set in after a calm find hypotheses that expect waves.
_LEAST_WAVES = 0.15


@tuned_options('cloud-kalman')
class CloudKalmanOptions(Options):
    """Options of the cloud-Kalman filter; the tuned values serve all motions and all waves."""

    window: float = option(50.0, 'positions that make up the cloud', '', (5.0, 1e4))
    still_density: float = option(
        1e-10, 'growth of the variance of a still target', 'm^2/s', (0.0, 1.0)
    )
    steady_density: float = option(
        1e-6, 'acceleration density of a steady target', 'm^2/s^3', (0.0, 1e3)
    )
    turn_acceleration: float = option(
        0.3, 'standard deviation of the acceleration of a turning target', 'm/s^2', (1e-4, 1e3)
    )
    turn_time: float = option(0.6, 'time over which a turn changes', 's', (0.01, 100.0))
    first_speed: float = option(
        0.15, 'standard deviation of the velocity of a target first seen', 'm/s', (1e-5, 100.0)
    )
    start_speed: float = option(
        0.02,
        'standard deviation of the velocity at which a still target starts',
        'm/s',
        (1e-5, 100),
    )
    still_dwell: float = option(6.0, 'mean time that a target is still', 's', (0.01, 1e4))
    steady_dwell: float = option(6.0, 'mean time that a target is steady', 's', (0.01, 1e4))
    turn_dwell: float = option(1.0, 'mean time that a target turns', 's', (0.01, 1e4))
    wave_std: float = option(
        0.002, 'deviation by waves across the line of sight, at the start', 'm', (1e-6, 1.0)
    )
    slow_waves: float = option(2.0, 'mean frequency of slow waves', 'Hz', (0.1, 100.0))
    quick_waves: float = option(3.8, 'mean frequency of quick waves', 'Hz', (0.1, 100.0))
    wave_dwell: float = option(10.0, 'mean time that waves stay slow or quick', 's', (0.01, 1e4))
    calm_dwell: float = option(20.0, 'mean time that water stays calm or rough', 's', (0.01, 1e4))
    wave_damping: float = option(0.25, "the waves' band, as a damping ratio", '', (0.01, 0.95))
    certainty_width: float = option(
        2.5, 'deviations at which the certainty is exp(-1/2)', '', (0.5, 100.0)
    )
    covariance_scale: float = option(1.0, 'factor on the covariance given out', '', (0.01, 100.0))

    def motion(self) -> Motion:
        """Return what the bank needs of the options."""
        return Motion(
            still_density=self.still_density,
            steady_density=self.steady_density,
            turn_acceleration=self.turn_acceleration,
            turn_time=self.turn_time,
            first_speed=self.first_speed,
            start_speed=self.start_speed,
            dwells=(self.still_dwell, self.steady_dwell, self.turn_dwell),
            wave_frequencies=(self.slow_waves, self.quick_waves),
            wave_dwell=self.wave_dwell,
            calm_dwell=self.calm_dwell,
            wave_damping=self.wave_damping,
        )


class _Memory(NamedTuple):
    """The bank; the cloud of innovations; the axes (..., 3, 3), rows, the last the line of sight.

    `wave` (..., 3) is the waves' variance along the axes, m^2; `trust` (..., 1) the mean
    certainty of late; `squares` (..., 3, 9) the products e e^T of the axes.
    """

    bank: Hypotheses
    cloud: RecursiveCloud
    wave: Array
    axes: Array
    certainty: Array
    trust: Array
    squares: Array


class CloudKalmanFilter(Filter[_Memory]):
    """Cloud-Kalman filter: the default smoother."""

    name: ClassVar[str] = 'cloud-kalman'
    options_class: ClassVar[type[Options]] = CloudKalmanOptions
    options: CloudKalmanOptions

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._bank = Bank(self.options.motion())
        self._by_least_waves = _ACROSS / (_LEAST_WAVES * self.options.wave_std) ** 2
        self._doubled_width = -2.0 * self.options.certainty_width**2

    def _start(self, position: Array, covariance: Array) -> _Memory:
        batch = position.shape[:-1]
        axes = _follow(np.broadcast_to(np.eye(3), (*batch, 3, 3)), covariance)
        variance = np.diagonal(_along(axes, covariance), axis1=-2, axis2=-1)
        # Waves shift pixels, so their errors in space have the proportions of the pixels' errors.
        wave = self.options.wave_std**2 * variance / (variance @ _ACROSS)
        bank = self._bank.start((axes @ position[..., None])[..., 0], variance, wave)
        total = np.full((*batch, 1), _DROPS_AT_START)
        cloud = RecursiveCloud.at_rest(np.sqrt(wave), total, self.options.window)
        trust = np.full((*batch, 1), _FIRST_TRUST)
        return _Memory(bank, cloud, wave, axes, np.ones(batch), trust, _squares(axes))

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        return _Memory(self._bank.advance(memory.bank, memory.wave, elapsed), *memory[1:])

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        memory, variance = _turned(memory, covariance)
        cloud = memory.cloud
        entropy = cloud.entropy
        squared_entropy = entropy * entropy
        measured = (memory.axes @ position[..., None])[..., 0]
        bank = _controlled(memory.bank, cloud.expectation, squared_entropy / self.options.window)
        innovation, expected, cross = innovations(bank, measured, variance)
        doubt = (cloud.variance @ _AXES) / (squared_entropy @ _AXES)
        widening = np.maximum(doubt, 1.0) / (memory.trust * memory.trust)
        certainty = self._certainty(innovation, expected, widening)
        bank = update(bank, innovation, expected, cross, certainty)
        drops = cloud.add(measured - mean_position(bank), certainty)
        entropy = drops.entropy
        least = variance / (variance @ self._by_least_waves)
        wave = np.maximum(entropy * entropy - variance, least)
        trust = memory.trust + _FORGETTING * (certainty - memory.trust)
        return _Memory(bank, drops, wave, memory.axes, certainty[..., 0], trust, memory.squares)

    def _certainty(self, innovation: Array, expected: Array, widening: Array) -> Array:
        """Return the certainty (..., 1) of an innovation, under the hypothesis it fits best.

        `widening` is the factor by which hyper-entropy, (En^2 + He^2) / En^2 over all axes, and
        a lack of trust raise the variance that a position may have.
        """
        squared = ((innovation * innovation / expected) @ _AXES)[..., 0]
        squared = np.minimum.reduce(squared, axis=-1, keepdims=True)
        return np.exp(squared / (self._doubled_width * widening))

    def _place(self, memory: _Memory) -> Array:
        return (mean_position(memory.bank)[..., None, :] @ memory.axes)[..., 0, :]

    def _estimate(self, memory: _Memory) -> Estimate:
        axes = memory.axes
        batch = axes.shape[:-2]
        mean, spread = moments(memory.bank)
        vectors = axes.swapaxes(-1, -2) @ mean
        # The sum over the axes e of (2, 2) blocks times e e^T, from (a, b, i, j) to (a i, b j).
        blocks = (self.options.covariance_scale * spread).reshape(*batch, 3, 4).swapaxes(-1, -2)
        covariance = (blocks @ memory.squares).reshape(*batch, 2, 2, 3, 3).swapaxes(-3, -2)
        return Estimate(
            vectors[..., 0],
            vectors[..., 1],
            covariance.reshape(*batch, 6, 6),
            memory.certainty * (memory.certainty > _LEAST_CERTAINTY),
        )


def _controlled(bank: Hypotheses, lag: Array, doubt: Array) -> Hypotheses:
    """Return the bank after the control input U = Ex of Eq. 16, as far as Ex stands out.

    The expectation `lag` (..., 3) of n drops that scatter by En is uncertain by the variance
    `doubt` = En^2 / n; what is taken of it is its share of the sum of both.
    """
    squared = lag * lag
    control = lag * (squared / (squared + doubt))
    states = bank.states.copy()
    states[..., TURNING, :, P] += control[..., None, :]
    return Hypotheses(states, bank.covariances, bank.weights)


def _along(axes: Array, covariance: Array) -> Array:
    """Return covariances (..., 3, 3) in the axes."""
    return axes @ covariance @ axes.swapaxes(-1, -2)


def _squares(axes: Array) -> Array:
    """Return e e^T (..., 3, 9) of the axes e, the rows of `axes` (..., 3, 3)."""
    return (axes[..., :, None] * axes[..., None, :]).reshape(*axes.shape[:-1], 9)


def _squared_length(vector: Array) -> Array:
    return (vector * vector) @ _AXES


def _turned(memory: _Memory, covariance: Array) -> tuple[_Memory, Array]:
    """Return the memory along axes that follow the line of sight, and the variances there.

    Positions, velocities and accelerations turn with the axes. Their variances stay with the axes:
    it is the line of sight that they come from, and a step turns it by next to nothing.
    """
    turned = _along(memory.axes, covariance)
    variance = turned.diagonal(axis1=-2, axis2=-1)
    off = np.abs(turned[..., 2, :2]) > _TURNED * variance[..., 2:]
    if not off.any():
        return memory, variance
    tilt = off[..., :1] | off[..., 1:]
    axes = np.where(tilt[..., None], _follow(memory.axes, covariance), memory.axes)
    turn = (axes @ memory.axes.swapaxes(-1, -2))[..., None, :, :]
    states = memory.bank.states
    states = np.concatenate([turn @ states[..., :3], states[..., 3:]], axis=-1)
    bank = memory.bank._replace(states=states)
    memory = memory._replace(bank=bank, axes=axes, squares=_squares(axes))
    return memory, np.diagonal(_along(axes, covariance), axis1=-2, axis2=-1)


def _follow(axes: Array, covariance: Array) -> Array:
    """Return orthonormal axes (..., 3, 3) near `axes`, the last one along the line of sight.

    That is the direction of least accuracy; one step of the power method from the last axis.
    """
    sight = (covariance @ axes[..., 2, :, None])[..., 0]
    sight = sight / np.sqrt(_squared_length(sight))
    first = axes[..., 0, :]
    first = first - (first * sight).sum(axis=-1, keepdims=True) * sight
    first = first / np.sqrt(_squared_length(first))
    return np.stack([first, np.cross(sight, first), sight], axis=-2)
