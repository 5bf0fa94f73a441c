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

Arrays have leading dimensions for batches, then the rung and the axis. Each component has an array
of its own: as small as they are, the number of calls is what costs, and strides cost more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.chain import eigenbasis
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.scalars import Number, beside, larger, product, smaller

Array = NDArray[np.float64]

#: Manoeuvring indices of the rungs: at rest, steady, and a decade each. A target at rest has no
#: velocity.
INDICES = np.array([0.0, 0.0, *(10.0**decade for decade in range(-5, 8))])
RUNGS = INDICES.size
REST = 0
#: Frames for which a target stays on a rung in the mean: longer where it is steady, as the lower
#: rungs are told from each other the later.
_DWELLS = np.where(INDICES < 0.1, 100.0, 20.0)
_DWELLS[REST + 1] = 200.0
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

_FIRST_SPEEDS = np.maximum((_FIRST_SPEED**2) * INDICES, _LEAST_FIRST_SPEED**2)[:, None]
_FIRST_SPEEDS[REST] = 0.0
_DRIVEN = INDICES[:, None]
_EVERY = np.ones(RUNGS)


class Switching(NamedTuple):
    """Of the rungs' Markov chain: eigenvalues (R,) per frame, and projections (R, R * R).

    The projections are transposed, so that they take the weights on as they stand.
    """

    rates: Array
    projections: Array


def switching(resting_frames: float) -> Switching:
    """Return how a target changes from rung to rung that stays at rest for so many frames."""
    dwells = _DWELLS.copy()
    dwells[REST] = resting_frames
    apart = np.abs(np.subtract.outer(np.arange(RUNGS), np.arange(RUNGS)))
    shares = np.where(apart == 0, 0.0, _FARTHER**apart)
    rates = shares / shares.sum(axis=1, keepdims=True) / dwells[:, None]
    eigenvalues, projections = eigenbasis(rates - np.diag(rates.sum(axis=1)))
    return Switching(eigenvalues, projections.swapaxes(-1, -2).reshape(RUNGS, -1))


class Ladder(NamedTuple):
    """The bank's memory; R = RUNGS.

    Attributes
    ----------
    places, speeds : (..., R, 3) array
        Position (m) and velocity (m/s) per rung and axis.
    place_variances, covariances, speed_variances : (..., R, 3) array
        Their variances, and the covariance of both.
    weights : (..., R, 3) array
        Probabilities of the rungs.
    variance : (..., 3) array
        Of the last measurement (m^2).
    interval : float or (...) array
        Time between frames (s); 0 until there were two.
    since : float or (...) array
        Time since the last measurement (s).

    """

    places: Array
    speeds: Array
    place_variances: Array
    covariances: Array
    speed_variances: Array
    weights: Array
    variance: Array
    interval: Number
    since: Number


def start(position: Array, variance: Array) -> Ladder:
    """Return the bank after a first position (..., 3) of that variance (..., 3) along the axes."""
    shape = (*position.shape[:-1], RUNGS, 3)
    places = np.broadcast_to(position[..., None, :], shape)
    variances = np.broadcast_to(variance[..., None, :], shape)
    nothing = np.zeros(shape)
    weights = np.full(shape, 1.0 / RUNGS)
    never = np.zeros(position.shape[:-1])[()]
    return Ladder(places, nothing, variances, nothing, nothing, weights, variance, never, never)


def advance(ladder: Ladder, chain: Switching, elapsed: Seconds) -> Ladder:
    """Return the bank `elapsed` seconds later."""
    interval = ladder.interval
    new = np.equal(interval, 0.0)
    if new.any():
        # Of the velocity is known what two positions can say of it.
        interval = np.where(new, np.clip(elapsed, *_INTERVALS), interval)[()]
        per_frame = ladder.variance / beside(interval * interval, 1)
        first = per_frame[..., None, :] * _FIRST_SPEEDS
        speed_variances = np.where(beside(new, 2), first, ladder.speed_variances)
        ladder = ladder._replace(speed_variances=speed_variances)
    frames = elapsed / interval
    switch = np.exp(np.multiply.outer(frames, chain.rates)).dot(chain.projections)
    # To the row's rung from the column's.
    switch = switch.reshape(*switch.shape[:-1], RUNGS, RUNGS)
    weights = product(switch, ladder.weights)
    share = 1.0 / weights
    origin = ladder.places[..., :1, :]
    place, speed, pp, pv, vv = (product(switch, each) * share for each in _moments(ladder, origin))
    pp -= place * place
    pv -= place * speed
    vv -= speed * speed
    for each in (speed, pv, vv):
        each[..., REST, :] = 0.0
    time = beside(elapsed, 2)
    gained = time * vv
    pp += time * (2.0 * pv + gained)
    pv += gained
    place += time * speed
    place += origin
    # White acceleration.
    rate = 1.0 / interval
    driven = ladder.variance[..., None, :] * _DRIVEN
    pp += beside(frames**3 / 3.0, 2) * driven
    pv += beside(0.5 * rate * frames**2, 2) * driven
    vv += beside(frames * rate * rate, 2) * driven
    since = ladder.since + elapsed
    return Ladder(place, speed, pp, pv, vv, weights, ladder.variance, interval, since)


def _moments(ladder: Ladder, origin: Array) -> tuple[Array, ...]:
    """Return each rung's share in the first and second moments of p and v, (..., R, 3) each.

    They are about `origin` (..., 1, 3), m, so that squares of positions do not swamp variances.
    """
    weights, p, v = ladder.weights, ladder.places - origin, ladder.speeds
    of_p, of_v = weights * p, weights * v
    pp = weights * ladder.place_variances + of_p * p
    pv = weights * ladder.covariances + of_p * v
    return of_p, of_v, pp, pv, weights * ladder.speed_variances + of_v * v


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
    own = variance[..., None, :]
    a, b = ladder.place_variances, ladder.covariances
    expected = a + own
    apart = position[..., None, :] - ladder.places
    # The density of positions by their narrowest explanation says how near is near.
    narrow = 1.0 / np.sqrt(_over_rungs(ladder.weights / expected))
    distance = np.abs(_over_rungs(ladder.weights * apart))
    reach = beside(0.5 * acceleration * ladder.since * ladder.since, 1) + _NEAR * narrow
    far = np.greater(distance, reach)
    # The gain is the optimal one or, on rungs that follow, 1.
    near, turn = a / expected, b / expected
    near[..., _FOLLOWS:, :] = 1.0
    pp, pv, vv = near * own, turn * own, ladder.speed_variances - turn * b
    by_place, by_speed = near * apart, turn * apart
    if far.any():
        astray = np.logical_or.reduce(far, axis=-1)
        # No rung may say that the target got further than it can.
        farthest = np.where(astray[..., None, None], (reach * reach)[..., None, :], np.inf)
        seen, likelihoods = _weighed(ladder.weights, apart, np.minimum(a, farthest) + own)
        # Of each axis, in logarithms.
        total, least = (each[..., 0, :] for each in likelihoods)
        likelihood = (np.log(total) - 0.5 * (least + _LOG_TWO_PI)).sum(axis=-1)
        radius = np.sqrt(((distance / narrow) ** 2).sum(axis=-1))
        wrong = _LOG_DENSITY - 3.0 * np.log(radius) - np.log(narrow).sum(axis=-1)
        odds = np.exp(np.clip(wrong - likelihood, -700, 700))
        odds *= wrong_share / (1.0 - wrong_share)
        certainty = np.where(astray, 1.0 / (1.0 + odds), 1.0)
        sure = certainty[..., None, None]
        seen *= sure
        weights = np.maximum(seen + (1.0 - sure) * ladder.weights, _LEAST_WEIGHT)
        # Of each rung the share of it that holds the position for the target's.
        taken = np.minimum(seen / weights, 1.0)
        both = taken * (1.0 - taken)
        pp = a + taken * (pp - a) + both * by_place * by_place
        pv = b + taken * (pv - b) + both * by_place * by_speed
        vv = ladder.speed_variances + taken * (vv - ladder.speed_variances)
        vv += both * by_speed * by_speed
        by_place *= taken
        by_speed *= taken
    else:
        weights, _ = _weighed(ladder.weights, apart, expected)
        np.maximum(weights, _LEAST_WEIGHT, out=weights)
        certainty = np.ones(far.shape[:-1])
    ratio = larger(ladder.since / ladder.interval, 1.0 / _LONGEST_RATIO)
    interval = ladder.interval * smaller(ratio, _LONGEST_RATIO) ** _NEW_INTERVAL
    interval = smaller(larger(interval, _INTERVALS[0]), _INTERVALS[1])
    places, speeds = ladder.places + by_place, ladder.speeds + by_speed
    after = Ladder(places, speeds, pp, pv, vv, weights, variance, interval, 0.0 * ladder.since)
    return Reading(after, certainty)


def _over_rungs(values: Array) -> Array:
    """Return the sum over rungs of values (..., R, 3)."""
    return product(_EVERY, values)


def _weighed(weights: Array, apart: Array, variance: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return the rungs' probabilities after a position, and what its likelihood is made of.

    That is their sum in units of the best rung's, and that one's exponent, (..., 1, 3) each.

    `apart` and `variance` (..., R, 3) are what it is off each rung's prediction, and was to be.
    """
    exponent = apart * apart
    exponent /= variance
    exponent += np.log(variance)
    least = np.minimum.reduce(exponent, axis=-2, keepdims=True)
    exponent -= least
    exponent *= -0.5
    seen = np.exp(exponent, out=exponent)
    seen *= weights
    total = np.add.reduce(seen, axis=-2, keepdims=True)
    seen /= total
    return seen, (total, least)


def mean_position(ladder: Ladder) -> Array:
    """Return the position (..., 3) along the axes, over all rungs."""
    origin = ladder.places[..., :1, :]
    return origin[..., 0, :] + _over_rungs(ladder.weights * (ladder.places - origin))


def moments(ladder: Ladder) -> tuple[Array, Array]:
    """Return means (..., 2, 3) and covariances (..., 3, 3) along the axes, over all rungs.

    In rows: position and velocity; the position's variances, covariances, the velocity's.
    """
    origin = ladder.places[..., :1, :]
    place, speed, pp, pv, vv = map(_over_rungs, _moments(ladder, origin))
    pp -= place * place
    pv -= place * speed
    vv -= speed * speed
    means = np.stack((place + origin[..., 0, :], speed), axis=-2)
    return means, np.stack((pp, pv, vv), axis=-2)


def turned(ladder: Ladder, turn: Array) -> Ladder:
    """Return the bank along axes that `turn` (..., 3, 3) makes of its own, by a small angle.

    Positions and velocities turn with the axes. Their variances stay with the axes: it is the line
    of sight that they come from, and a step turns it by next to nothing.
    """
    across = turn.swapaxes(-1, -2)
    return ladder._replace(places=ladder.places @ across, speeds=ladder.speeds @ across)
