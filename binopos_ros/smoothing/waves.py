"""A filter of positions that are seen through waves, steered by the cloud of what it leaves.

The paper's idea, made to work for a target that moves:

* the cloud's drops are what is left of the measured positions once the target's filtered position
  is taken off;
* its expectation is a lag: the control input of the turning hypothesis (Eq. 16), as far as it
  stands out of its own uncertainty;
* its entropy is the waves' present spread, in the bounds that the measurement's covariance sets;
* its hyper-entropy says how far that spread can be trusted: it widens the certainty;
* its certainty (Eq. 24) weighs each measurement: Welsch's weight exp(-(d / width)^2 / 2) of robust
  statistics (Dennis & Welsch, Commun. Stat. Simul. Comput. 7(4), 1978);
* a run of positions with little certainty shakes the trust in the filter itself, and widens the
  certainty until it takes them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing import wave_bank
from binopos_ros.smoothing.cloud import RecursiveCloud
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.scalars import (
    Number,
    components,
    exponential,
    larger,
    smaller,
    vector,
)
from binopos_ros.smoothing.wave_bank import Bank, Hypotheses
from binopos_ros.smoothing.wave_bases import AXES, SIZE, Motion, S

Array = NDArray[np.float64]

#: Positions that make up the cloud, and deviations at which the certainty is exp(-1/2).
_WINDOW, _CERTAINTY_WIDTH = 33.76, 1.781
_BY_WIDTH = -0.5 / _CERTAINTY_WIDTH**2
#: Drops that the waves' spread at the start counts for.
_DROPS_AT_START = 10.0
#: Share of the newest certainty in the trust: wrong detections seldom come in a row.
_FORGETTING = 0.3
#: Trust in the filter at the start: it has yet to be earned, and a quick target must be taken.
_FIRST_TRUST = 0.3
#: The least deviation of waves, in that of the whole measurement: so waves that set in after a
#: calm find hypotheses that expect them.
_LEAST_WAVES = 0.1
#: Deviation that waves may have that are seen for the first time, in that of the pixels' noise.
_FIRST_WAVES = 10.0
#: The largest, in the medium's: the rays' miss tells the waves' size to a factor of two.
_MOST_WAVES = 2.0
#: Deviations within which an honest position lies.
_HONEST = 3.0
#: Share of the waves' variance that all axes have in common, in units of the pixels' variance.
_POOLED = 0.5

_BANK = Bank(Motion())


class Clouds(NamedTuple):
    """The clouds of what is left along the axes: two across the line of sight, one along it."""

    first: RecursiveCloud
    second: RecursiveCloud
    sight: RecursiveCloud


class Waves(NamedTuple):
    """The filter's memory.

    Attributes
    ----------
    bank : Hypotheses
        Of the target's motion and the waves.
    clouds : Clouds
        Of what is left along each axis.
    spread : (..., 3) array
        The waves' variance along the axes (m^2).
    trust : float or (N,) array
        Mean certainty of late.

    """

    bank: Hypotheses
    clouds: Clouds
    spread: Array
    trust: Number


class Reading(NamedTuple):
    """What a measurement did to the filter.

    Attributes
    ----------
    waves : Waves
        The filter after it.
    certainty : float or (N,) array
        The weight that it was taken with.
    left : list of three float or (N,) array
        What it leaves along the axes (m).

    """

    waves: Waves
    certainty: Number
    left: list[Number]


def start(position: Array, noise: Array, medium: Array) -> Waves:
    """Return the filter after a first position (..., 3) along the axes.

    `noise` and `medium` (..., 3) are the variances of the pixels and of the waves (m^2).
    """
    spread = np.maximum(medium, _FIRST_WAVES**2 * noise)
    clouds = Clouds(
        *(
            RecursiveCloud.at_rest(each**0.5, _DROPS_AT_START, _WINDOW)
            for each in components(noise + spread)
        )
    )
    trust = np.full(position.shape[:-1], _FIRST_TRUST) if position.ndim > 1 else _FIRST_TRUST
    return Waves(_BANK.start(position, noise, spread), clouds, spread, trust)


def advance(waves: Waves, elapsed: Seconds) -> Waves:
    """Return the filter `elapsed` seconds later."""
    return waves._replace(bank=_BANK.advance(waves.bank, waves.spread, elapsed))


def correct(waves: Waves, position: Array, noise: Array, medium: Array) -> Reading:
    """Return the filter after a position (..., 3) along the axes; see :func:`start`."""
    clouds = waves.clouds
    bank = wave_bank.controlled(waves.bank, vector(_control(cloud) for cloud in clouds))
    seen = wave_bank.innovations(bank, position, noise)
    # Hyper-entropy and a lack of trust raise the variance that a position may have, under the
    # hypothesis that it fits best.
    width = larger(_spread_doubt(clouds), 1.0) / (waves.trust * waves.trust)
    certainty = exponential(_BY_WIDTH * seen.nearest / width)
    bank = wave_bank.update(bank, seen, certainty)
    left = components(position - wave_bank.mean_position(bank))
    clouds = Clouds(
        *(cloud.add(drop, certainty) for cloud, drop in zip(clouds, left, strict=True))
    )
    trust = waves.trust + _FORGETTING * (certainty - waves.trust)
    spread = vector(_spreads(clouds, components(noise), components(medium)))
    return Reading(Waves(bank, clouds, spread, trust), certainty, left)


def believable(reading: Reading, noise: Array, medium: Array, alone: Number) -> Number:
    """Return from 0 to 1 how far the filter keeps to what is measured; see :func:`start`.

    Waves leave the mean in its place, and a lag beyond what they may be is the target's motion.
    So is, until the filter is believed alone, a position that lies farther off than they are high:
    chance in the rays' miss, too, looks like waves. `alone` is 1 from then on, and 0 before.
    """
    farthest: Number = 0.0
    for cloud, left, own, most in zip(
        reading.waves.clouds, reading.left, components(noise), components(medium), strict=True
    ):
        lag = abs(cloud.expectation) / (_MOST_WAVES * (own + most) ** 0.5)
        apart = abs(left) / (_HONEST * (own + _MOST_WAVES**2 * most) ** 0.5)
        farthest = larger(farthest, larger(lag, apart * (1.0 - alone)))
    return smaller(larger(2.0 - farthest, 0.0), 1.0)


def mean_position(waves: Waves) -> Array:
    """Return the position (..., 3) along the axes."""
    return wave_bank.mean_position(waves.bank)


def moments(waves: Waves) -> tuple[Array, Array]:
    """Return mean (..., 6) and covariance (..., 6, 6) of p and v along the axes."""
    return wave_bank.moments(waves.bank)


def turned(waves: Waves, turn: Array) -> Waves:
    """Return the filter along axes that `turn` (..., 3, 3) makes of its own.

    Positions, velocities and accelerations turn with the axes. Their variances stay with the axes:
    it is the line of sight that they come from, and a step turns it by next to nothing.
    """
    flat = waves.bank.states
    states = flat.reshape(*waves.bank.weights.shape, SIZE, AXES)
    kinematic = states[..., :S, :] @ turn[..., None, :, :].swapaxes(-1, -2)
    states = np.concatenate([kinematic, states[..., S:, :]], axis=-2)
    return waves._replace(bank=waves.bank._replace(states=states.reshape(flat.shape)))


def _spreads(clouds: Clouds, noise: list[Number], medium: list[Number]) -> Iterator[Number]:
    """Yield the waves' variances: entropies' squares less the noise, as the medium bounds them.

    Waves shift pixels, so half of what is known of them on one axis serves the others too.
    """
    shares = [cloud.entropy**2 / own - 1.0 for cloud, own in zip(clouds, noise, strict=True)]
    common = _POOLED / 3.0 * (shares[0] + shares[1] + shares[2])
    for share, own, most in zip(shares, noise, medium, strict=True):
        least = _LEAST_WAVES**2 * (own + most)
        spread = larger(own * (common + (1.0 - _POOLED) * share), least)
        yield smaller(spread, larger(_MOST_WAVES**2 * most, least))


def _control(cloud: RecursiveCloud) -> Number:
    """Return the control input U = Ex of Eq. 16, as far as Ex stands out.

    The expectation of n drops that scatter by En is uncertain by the variance En^2 / n; what is
    taken of it is its share of the sum of both.
    """
    lag, entropy = cloud.expectation, cloud.entropy
    squared = lag * lag
    return lag * squared / (squared + entropy * entropy / cloud.window)


def _spread_doubt(clouds: Clouds) -> Number:
    """Return (En^2 + He^2) / En^2 over all axes, where He^2 may be negative."""
    entropies = [cloud.entropy for cloud in clouds]
    variance = clouds[0].variance + clouds[1].variance + clouds[2].variance
    return variance / (entropies[0] ** 2 + entropies[1] ** 2 + entropies[2] ** 2)
