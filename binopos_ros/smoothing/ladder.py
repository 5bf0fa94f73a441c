"""A bank of constant-velocity Kalman filters, one for each decade of how freely the target moves.

What decides a tracker's gain is one number without a unit, the manoeuvring index (Kalata, "The
tracking index", IEEE TAES 20(2), 1984): here the density of the white acceleration that drives the
target, times the cube of the time between frames, over the variance of a measurement. A target
with an index of 0 keeps its velocity for ever, one with an index of 1e7 is where it was measured
last. The rungs of the ladder are these and the decades between, so the bank needs no metre and no
second: the same motion at another scale, rate or distance is filtered alike.

Each axis has a ladder of its own, so that a target that swings to and fro sideways may rest along
the line of sight. The rungs interact as in Blom & Bar-Shalom, "The interacting multiple model
algorithm for systems with Markovian switching coefficients", IEEE TAC 33(8), 1988, by a Markov
chain in continuous time, whose unit is the time between frames. Seen as a cloud, the rungs are the
widths that it may have: a normal cloud is a normal distribution whose width is itself uncertain.

Arrays have leading dimensions for batches, then the rung, the axis and the component: position and
velocity, then their variances and, between them, their covariance. A step is a few products: on
arrays as small as these the number of calls is what costs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.chain import eigenbasis
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.scalars import Number, larger, product, smaller

Array = NDArray[np.float64]

#: Manoeuvring indices of the rungs: at rest, steady, and a decade each. A target at rest has no
#: velocity.
INDICES = np.array([0.0, 0.0, *(10.0**decade for decade in range(-5, 8))])
RUNGS = INDICES.size
REST = 0
#: Frames for which a target stays on a rung in the mean: longer where it is steady, as the lower
#: rungs are told from each other the later.
_DWELLS = np.where(INDICES < 0.1, 100.0, 20.0)
_DWELLS[REST], _DWELLS[REST + 1] = 20.0, 200.0
#: A rung further is that much rarer.
_FARTHER = 0.5
#: Deviation of the velocity at first on a rung, in those that it gains in a frame.
_FIRST_SPEED = 10.0
#: Of a velocity of which a rung itself says nothing, per frame, in deviations of the measurement.
_LEAST_FIRST_SPEED = 1.0
#: From this rung on the gain of the position is above 0.97: taken for 1, so that nothing lags.
_FOLLOWS = int(np.searchsorted(INDICES, 100.0))
#: Share of the newest interval in the time between frames, and how far it may differ.
_NEW_INTERVAL, _LONGEST_RATIO = 0.1, 3.0
#: No camera is quicker, none is slower (s).
_INTERVALS = (1e-6, 1e3)
#: No rung is ever ruled out for good.
_LEAST_WEIGHT = 1e-12
#: What is near enough to a prediction to be taken without a question, in deviations.
_NEAR = 4.0
#: Wrong positions may lie anywhere from a deviation to ten thousand from the target, in each
#: decade and direction alike.
_LOG_DENSITY = -math.log(4.0 * math.pi * math.log(1e4))
_LOG_TWO_PI = math.log(2.0 * math.pi)

# Components: position, velocity; variance of the position, covariance, variance of the velocity.
P, V, PP, PV, VV = range(5)
_SIZE = 5
# Of position and velocity the factors of their three products.
_LEFT = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
_RIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]])
# What takes the components some time on: of its powers 0, 1 and 2.
_POWERS = np.zeros((3, _SIZE, _SIZE))
_POWERS[0] = np.eye(_SIZE)
_POWERS[1, V, P] = _POWERS[1, VV, PV] = 1.0
_POWERS[1, PV, PP], _POWERS[2, VV, PP] = 2.0, 1.0
_FIRST_SPEEDS = np.maximum((_FIRST_SPEED**2) * INDICES, _LEAST_FIRST_SPEED**2)
_FIRST_SPEEDS[REST] = 0.0
_DRIVEN = INDICES[:, None, None]
_EXPONENTS = np.arange(3.0)


def _generator() -> Array:
    """Return the rates (R, R) per frame at which a target changes from rung to rung."""
    apart = np.abs(np.subtract.outer(np.arange(RUNGS), np.arange(RUNGS)))
    shares = np.where(apart == 0, 0.0, _FARTHER**apart)
    rates = shares / shares.sum(axis=1, keepdims=True) / _DWELLS[:, None]
    return rates - np.diag(rates.sum(axis=1))


_RATES, _SWITCHES = eigenbasis(_generator())
# Transposed, so that they take the weights on as they stand.
_SWITCHES = _SWITCHES.swapaxes(-1, -2).reshape(RUNGS, -1)


class Ladder(NamedTuple):
    """The bank's memory; R = RUNGS.

    Attributes
    ----------
    states : (..., R, 3, 5) array
        Per rung and axis: position (m), velocity (m/s), their variances and covariance.
    weights : (..., R, 3) array
        Probabilities of the rungs.
    variance : (..., 3) array
        Of the last measurement (m^2).
    interval : float or (...) array
        Time between frames (s); 0 until there were two.
    since : float or (...) array
        Time since the last measurement (s).

    """

    states: Array
    weights: Array
    variance: Array
    interval: Number
    since: Number


def start(position: Array, variance: Array) -> Ladder:
    """Return the bank after a first position (..., 3) of that variance (..., 3) along the axes."""
    batch = position.shape[:-1]
    states = np.zeros((*batch, RUNGS, 3, _SIZE))
    states[..., P] = position[..., None, :]
    states[..., PP] = variance[..., None, :]
    weights = np.full((*batch, RUNGS, 3), 1.0 / RUNGS)
    none = np.zeros(batch)[()]
    return Ladder(states, weights, variance, none, none)


def advance(ladder: Ladder, elapsed: Seconds) -> Ladder:
    """Return the bank `elapsed` seconds later."""
    interval, states = ladder.interval, ladder.states
    if not np.all(interval):
        # Of the velocity is known what two positions can say of it.
        new = np.asarray(interval) == 0.0
        interval = np.where(new, np.clip(elapsed, *_INTERVALS), interval)[()]
        per_frame = (ladder.variance / np.asarray(interval * interval)[..., None])[..., None, :]
        states = states.copy()
        first = per_frame * _FIRST_SPEEDS[:, None]
        states[..., VV] = np.where(new[..., None, None], first, states[..., VV])
    frames = elapsed / interval
    switch = np.exp(np.multiply.outer(frames, _RATES)).dot(_SWITCHES)
    # To the row's rung from the column's.
    switch = switch.reshape(*switch.shape[:-1], RUNGS, RUNGS)
    weights = product(switch, ladder.weights)
    # About the first rung's state, so that squares of positions do not swamp variances.
    origin = states[..., :1, :, :PP]
    moments = _about(states, origin)
    moments *= ladder.weights[..., None]
    flat = moments.reshape(*switch.shape[:-1], -1)
    mixed = product(switch, flat).reshape(moments.shape)
    mixed /= weights[..., None]
    mean = mixed[..., :PP]
    mixed[..., PP:] -= mean.dot(_LEFT) * mean.dot(_RIGHT)
    mean += origin
    mixed[..., REST, :, V::2] = 0.0
    mixed[..., REST, :, VV] = 0.0
    onward = (np.asarray(elapsed)[..., None] ** _EXPONENTS).dot(_POWERS.reshape(3, -1))
    onward = onward.reshape(*onward.shape[:-1], 1, _SIZE, _SIZE)
    moved = mixed @ onward if np.ndim(elapsed) else mixed.dot(onward[0])
    rate = 1.0 / interval
    row = np.array((frames**3 / 3.0, 0.5 * rate * frames**2, frames * rate * rate)).T
    driven = row[..., None, None, :] * ladder.variance[..., None, :, None]
    moved[..., PP:] += driven * _DRIVEN
    return Ladder(moved, weights, ladder.variance, interval, ladder.since + elapsed)


def _about(states: Array, origin: Array) -> Array:
    """Return first and second moments (..., 5) of each rung and axis about an origin (..., 2)."""
    moments = states.copy()
    first = moments[..., :PP]
    first -= origin
    moments[..., PP:] += first.dot(_LEFT) * first.dot(_RIGHT)
    return moments


class Reading(NamedTuple):
    """What a measurement did to the bank.

    Attributes
    ----------
    ladder : Ladder
        After it.
    certainty : (...) array
        Probability that the position is the target's, not another thing's.

    """

    ladder: Ladder
    certainty: Array


def correct(
    ladder: Ladder, position: Array, variance: Array, wrong_share: float, acceleration: Array
) -> Reading:
    """Return the bank after a position (..., 3) of that variance (..., 3) along the axes.

    A position further from the prediction than `acceleration` (...), m/s^2, could take the target
    is weighed against one that is not the target's, of which there is a share of `wrong_share`.
    """
    before, own = ladder.states, variance[..., None, :]
    expected = before[..., PP] + own
    apart = position[..., None, :] - before[..., P]
    # The density of positions by their narrowest explanation says how near is near.
    narrow = 1.0 / np.sqrt(_over_rungs(ladder.weights / expected))
    distance = np.abs(_over_rungs(ladder.weights * apart))
    reach = 0.5 * acceleration * ladder.since * ladder.since
    reach = np.asarray(reach)[..., None] + _NEAR * narrow
    far = distance > reach
    # Variances after it, whose gain is the optimal one or, on rungs that follow, 1.
    gain = before[..., PP:VV] / expected[..., None]
    gain[..., _FOLLOWS:, :, 0] = 1.0
    states = before.copy()
    np.multiply(gain, own[..., None], out=states[..., PP:VV])
    states[..., VV] -= gain[..., 1] * before[..., PV]
    moved = gain * apart[..., None]
    if far.any():
        astray = far.any(axis=-1)
        # No rung may say that the target got further than it can.
        farthest = np.where(astray[..., None, None], (reach * reach)[..., None, :], np.inf)
        seen, likelihood = _weighed(ladder, apart, np.minimum(before[..., PP], farthest) + own)
        radius = np.sqrt(((distance / narrow) ** 2).sum(axis=-1))
        wrong = _LOG_DENSITY - 3.0 * np.log(radius) - np.log(narrow).sum(axis=-1)
        odds = wrong_share / (1.0 - wrong_share) * np.exp(np.clip(wrong - likelihood, -700, 700))
        certainty = np.where(astray, 1.0 / (1.0 + odds), 1.0)
        sure = certainty[..., None, None]
        seen *= sure
        weights = np.maximum(seen + (1.0 - sure) * ladder.weights, _LEAST_WEIGHT)
        # Of each rung the share of it that holds the position for the target's.
        taken = np.minimum(seen / weights, 1.0)[..., None]
        states[..., PP:] = before[..., PP:] + taken * (states[..., PP:] - before[..., PP:])
        states[..., PP:] += taken * (1.0 - taken) * (moved.dot(_LEFT) * moved.dot(_RIGHT))
        moved *= taken
    else:
        seen, _ = _weighed(ladder, apart, expected)
        weights = np.maximum(seen, _LEAST_WEIGHT, out=seen)
        certainty = np.ones(far.shape[:-1])
    states[..., :PP] += moved
    ratio = larger(ladder.since / ladder.interval, 1.0 / _LONGEST_RATIO)
    interval = ladder.interval * smaller(ratio, _LONGEST_RATIO) ** _NEW_INTERVAL
    interval = smaller(larger(interval, _INTERVALS[0]), _INTERVALS[1])
    return Reading(Ladder(states, weights, variance, interval, 0.0 * ladder.since), certainty)


def _over_rungs(values: Array) -> Array:
    """Return the sum over rungs of values (..., R, 3)."""
    return np.add.reduce(values, axis=-2)


def _weighed(ladder: Ladder, apart: Array, variance: Array) -> tuple[Array, Array]:
    """Return the rungs' probabilities after a position, and log likelihoods (...) of all axes.

    `apart` and `variance` (..., R, 3) are what it is off each rung's prediction, and was to be.
    """
    exponent = apart * apart
    exponent /= variance
    exponent += np.log(variance)
    least = np.minimum.reduce(exponent, axis=-2, keepdims=True)
    exponent -= least
    exponent *= -0.5
    seen = np.exp(exponent, out=exponent)
    seen *= ladder.weights
    total = np.add.reduce(seen, axis=-2, keepdims=True)
    seen /= total
    each = np.log(total[..., 0, :]) - 0.5 * (least[..., 0, :] + _LOG_TWO_PI)
    return seen, each.sum(axis=-1)


def mean_position(ladder: Ladder) -> Array:
    """Return the position (..., 3) along the axes, over all rungs."""
    origin = ladder.states[..., :1, :, P]
    return origin[..., 0, :] + _over_rungs(ladder.weights * (ladder.states[..., P] - origin))


def moments(ladder: Ladder) -> tuple[Array, Array]:
    """Return mean (..., 3, 2) and covariance (..., 3, 3) of p and v along the axes, over all.

    The covariance of each axis is that of the position, of both, and of the velocity.
    """
    origin = ladder.states[..., :1, :, :PP]
    about = _about(ladder.states, origin)
    about *= ladder.weights[..., None]
    summed = np.add.reduce(about, axis=-3)
    mean = summed[..., :PP]
    spread = summed[..., PP:] - mean.dot(_LEFT) * mean.dot(_RIGHT)
    return mean + origin[..., 0, :, :], spread


def turned(ladder: Ladder, turn: Array) -> Ladder:
    """Return the bank along axes that `turn` (..., 3, 3) makes of its own, by a small angle.

    Positions and velocities turn with the axes. Their variances stay with the axes: it is the line
    of sight that they come from, and a step turns it by next to nothing.
    """
    states = ladder.states.copy()
    states[..., :PP] = turn[..., None, :, :] @ ladder.states[..., :PP]
    return ladder._replace(states=states)
