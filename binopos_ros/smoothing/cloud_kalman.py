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
from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.bank import (
    Bank,
    Hypotheses,
    controlled,
    innovations,
    mean_position,
    moments,
    product,
    update,
)
from binopos_ros.smoothing.base import Estimate, Filter
from binopos_ros.smoothing.bases import AXES, CALM_WATER, MOTION, SIZE, WATER, Motion, S
from binopos_ros.smoothing.cloud import RecursiveCloud
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, option, tuned_options
from binopos_ros.smoothing.scalars import (
    Number,
    beside,
    components,
    exponential,
    larger,
    rows,
    vector,
)

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
#: Swell: slower than basins' waves, and nearly of one pure tone (Hz, damping ratio).
_SWELL, _SWELL_DAMPING = 1.1, 0.08
#: Share of the waves' variance that all axes have in common, in units of the pixels' variance.
_POOLED = 0.5


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
    pause_dwell: float = option(
        2.0, 'mean time that a target is still that pauses', 's', (0.01, 1e4)
    )
    rest_dwell: float = option(
        200.0, 'mean time that a target is still that rests', 's', (0.01, 1e4)
    )
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
    paused_scale: float = option(
        1.0, 'factor on the covariance of a still target that pauses', '', (0.0, 1e3)
    )
    resting_scale: float = option(
        1.0, 'factor on the covariance of a still target that rests', '', (0.0, 1e3)
    )
    steady_scale: float = option(
        1.0, 'factor on the covariance of a steady target', '', (0.0, 1e3)
    )
    turning_scale: float = option(
        1.0, 'factor on the covariance of a turning target', '', (0.0, 1e3)
    )
    means_scale: float = option(
        1.0, "factor on the spread of the hypotheses' means", '', (0.0, 1e3)
    )

    def motion(self) -> Motion:
        """Return what the bank needs of the options."""
        return Motion(
            still_density=self.still_density,
            steady_density=self.steady_density,
            turn_acceleration=self.turn_acceleration,
            turn_time=self.turn_time,
            first_speed=self.first_speed,
            start_speed=self.start_speed,
            pause_dwell=self.pause_dwell,
            rest_dwell=self.rest_dwell,
            steady_dwell=self.steady_dwell,
            turn_dwell=self.turn_dwell,
            wave_frequencies=(self.slow_waves, self.quick_waves, _SWELL),
            wave_dwell=self.wave_dwell,
            calm_dwell=self.calm_dwell,
            wave_dampings=(self.wave_damping, self.wave_damping, _SWELL_DAMPING),
        )


class _Clouds(NamedTuple):
    """The clouds of innovations along the axes: two across the line of sight, one along it."""

    first: RecursiveCloud
    second: RecursiveCloud
    sight: RecursiveCloud


class _Memory(NamedTuple):
    """The bank; the clouds; the axes (..., 3, 3), rows, the last one the line of sight.

    `wave` (..., 3) is the waves' variance along the axes, m^2; `trust` the mean certainty of
    late; `turn` (..., 6, 6) turns positions and velocities into the axes; `roughness` says how
    far the factors on the covariance hold.
    """

    bank: Hypotheses
    clouds: _Clouds
    wave: Array
    axes: Array
    certainty: Number
    trust: Number
    turn: Array
    roughness: Number


class CloudKalmanFilter(Filter[_Memory]):
    """Cloud-Kalman filter: the default smoother."""

    name: ClassVar[str] = 'cloud-kalman'
    options_class: ClassVar[type[Options]] = CloudKalmanOptions
    options: CloudKalmanOptions

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._bank = Bank(self.options.motion())
        self._by_width = -0.5 / self.options.certainty_width**2
        motions = (
            self.options.paused_scale,
            self.options.steady_scale,
            self.options.turning_scale,
        )
        self._least_wave = (_LEAST_WAVES * self.options.wave_std) ** 2
        # Of the factors on the hypotheses' covariances what is not 1, as it is in calm water.
        self._scales = np.where(WATER == CALM_WATER, 0.0, np.array(motions)[MOTION] - 1.0)
        rest = self.options.resting_scale - self.options.paused_scale
        self._rest_scales = np.where((WATER != CALM_WATER) & (MOTION == 0), rest, 0.0)

    def _start(self, position: Array, covariance: Array) -> _Memory:
        batch = position.shape[:-1]
        axes = _follow(np.broadcast_to(np.eye(3), (*batch, 3, 3)), covariance)
        variance = np.diagonal(_along(axes, covariance), axis1=-2, axis2=-1)
        # Waves shift pixels, so their errors in space have the proportions of the pixels' errors.
        wave = self.options.wave_std**2 * variance / variance.dot(_ACROSS)
        window = self.options.window
        clouds = _Clouds(
            *(
                RecursiveCloud.at_rest(each**0.5, _DROPS_AT_START, window)
                for each in components(wave)
            )
        )
        bank = self._bank.start((axes @ position[..., None])[..., 0], variance, wave)
        one = np.ones(batch) if batch else 1.0
        return _Memory(bank, clouds, wave, axes, one, _FIRST_TRUST * one, _twice(axes), one)

    def _advance(self, memory: _Memory, elapsed: Seconds) -> _Memory:
        return _Memory(self._bank.advance(memory.bank, memory.wave, elapsed), *memory[1:])

    def _correct(self, memory: _Memory, position: Array, covariance: Array) -> _Memory:
        memory, variance = _turned(memory, covariance)
        clouds, trust = memory.clouds, memory.trust
        measured = product(memory.axes, position[..., None])[..., 0]
        bank = controlled(memory.bank, vector(_control(cloud) for cloud in clouds))
        seen = innovations(bank, measured, vector(variance))
        # Hyper-entropy and a lack of trust raise the variance that a position may have, under the
        # hypothesis that it fits best.
        width = larger(_spread_doubt(clouds), 1.0) / (trust * trust)
        certainty = exponential(self._by_width * seen.nearest / width)
        bank = update(bank, seen, certainty)
        left = components(measured - mean_position(bank))
        drops = _Clouds(
            *(cloud.add(drop, certainty) for cloud, drop in zip(clouds, left, strict=True))
        )
        waves = list(self._waves(drops, variance))
        trust = trust + _FORGETTING * (certainty - trust)
        roughness = self._roughness(waves[0], waves[1])
        return _Memory(
            bank, drops, vector(waves), memory.axes, certainty, trust, memory.turn, roughness
        )

    def _waves(self, clouds: _Clouds, variance: list[Number]) -> Iterator[Number]:
        """Yield the waves' variances: the entropies' squares less the measurement's variances.

        Waves shift pixels, so half of what is known of them on one axis serves the others too.
        """
        shares = [
            cloud.entropy**2 / own - 1.0 for cloud, own in zip(clouds, variance, strict=True)
        ]
        common = _POOLED / 3.0 * (shares[0] + shares[1] + shares[2])
        least = self._least_wave / (0.5 * (variance[0] + variance[1]))
        for share, own in zip(shares, variance, strict=True):
            yield own * larger(common + (1.0 - _POOLED) * share, least)

    def _roughness(self, first: Number, second: Number) -> Number:
        """Return how far waves of those variances across the line of sight are from the least.

        From 0 to nearly 1: the factors on the covariance are for waves, not for pixels' noise.
        """
        share = self._least_wave / (0.5 * (first + second))
        return 1.0 - share * share

    def _place(self, memory: _Memory) -> Array:
        return product(mean_position(memory.bank)[..., None, :], memory.axes)[..., 0, :]

    def _estimate(self, memory: _Memory) -> Estimate:
        bank, turn = memory.bank, memory.turn
        scales = self._scales + beside(bank.resting, 1) * self._rest_scales
        scales = 1.0 + beside(memory.roughness, 1) * scales
        mean, spread = moments(bank, scales, self.options.means_scale)
        vector = product(mean[..., None, :], turn)[..., 0, :]
        covariance = product(product(turn.swapaxes(-1, -2), spread), turn)
        used: Any = memory.certainty * (memory.certainty > _LEAST_CERTAINTY)
        return Estimate(vector[..., :3], vector[..., 3:], covariance, used)


def _control(cloud: RecursiveCloud) -> Number:
    """Return the control input U = Ex of Eq. 16, as far as Ex stands out.

    The expectation of n drops that scatter by En is uncertain by the variance En^2 / n; what is
    taken of it is its share of the sum of both.
    """
    lag, entropy = cloud.expectation, cloud.entropy
    squared = lag * lag
    return lag * squared / (squared + entropy * entropy / cloud.window)


def _spread_doubt(clouds: _Clouds) -> Number:
    """Return (En^2 + He^2) / En^2 over all axes, where He^2 may be negative."""
    one, two, three = (cloud.entropy for cloud in clouds)
    variance = clouds.first.variance + clouds.second.variance + clouds.sight.variance
    return variance / (one * one + two * two + three * three)


def _along(axes: Array, covariance: Array) -> Array:
    """Return covariances (..., 3, 3) in the axes."""
    return product(product(axes, covariance), axes.swapaxes(-1, -2))


def _twice(axes: Array) -> Array:
    """Return the turn (..., 6, 6) of a position and a velocity into the axes (..., 3, 3)."""
    turn = np.zeros((*axes.shape[:-2], 6, 6))
    turn[..., :3, :3] = turn[..., 3:, 3:] = axes
    return turn


def _squared_length(vector: Array) -> Array:
    return (vector * vector).dot(_AXES)


def _turned(memory: _Memory, covariance: Array) -> tuple[_Memory, list[Number]]:
    """Return the memory along axes that follow the line of sight, and the variances there.

    Positions, velocities and accelerations turn with the axes. Their variances stay with the axes:
    it is the line of sight that they come from, and a step turns it by next to nothing.
    """
    (first, _, _), (_, second, _), (slant, tilt, sight) = rows(_along(memory.axes, covariance))
    tilted = (abs(slant) > _TURNED * sight) | (abs(tilt) > _TURNED * sight)
    if tilted is False or not np.any(tilted):
        return memory, [first, second, sight]
    tilted = np.asarray(tilted)[..., None, None]
    axes = np.where(tilted, _follow(memory.axes, covariance), memory.axes)
    turn = (axes @ memory.axes.swapaxes(-1, -2))[..., None, :, :]
    states = memory.bank.states.reshape(*memory.bank.weights.shape, SIZE, AXES)
    kinematic = states[..., :S, :] @ turn.swapaxes(-1, -2)
    states = np.concatenate([kinematic, states[..., S:, :]], axis=-2)
    bank = memory.bank._replace(states=states.reshape(memory.bank.states.shape))
    memory = memory._replace(bank=bank, axes=axes, turn=_twice(axes))
    variance = np.diagonal(_along(axes, covariance), axis1=-2, axis2=-1)
    return memory, components(variance)


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
