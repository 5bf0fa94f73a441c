"""A bank of constant-velocity Kalman filters, one for each decade of how freely the target moves.

What decides a tracker's gain is one number without a unit, the manoeuvring index (Kalata, "The
tracking index", IEEE TAES 20(2), 1984): here the density of the white acceleration that drives the
target, times the cube of the time between frames, over the variance of a measurement. A target
with an index of 0 keeps its velocity for ever, one with an index of 1e7 is where it was measured
last. The rungs of the ladder are these and the decades between, so the bank needs no metre and no
second: the same motion at another scale, rate or distance is filtered alike.

A target that goes to and fro within five frames, as one does before a rig that is shaken, has a
velocity that foretells the wrong side. Two rungs more let it wander without one.

Each axis has a ladder of its own, so that a target that swings to and fro sideways may rest along
the line of sight. The rungs interact as in Blom & Bar-Shalom, "The interacting multiple model
algorithm for systems with Markovian switching coefficients", IEEE TAC 33(8), 1988, by a Markov
chain in continuous time, whose unit is the time between frames. Seen as a cloud, the rungs are the
widths that it may have: a normal cloud is a normal distribution whose width is itself uncertain.

What is kept of a rung is its share in the probability and in the first two moments of position and
velocity: interaction and motion are linear in these, so each is one product over all rungs and
axes at once. Arrays have leading dimensions for batches, then the moment, the axis and the rung.
What costs is the number of calls, three times as much where shapes have to be stretched.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.rungs import (
    DRIVEN,
    FIRST_SPEEDS,
    FIRST_WEIGHTS,
    FOLLOWS,
    LEAST_WEIGHT,
    RUNGS,
    STANDING,
    WALKED,
    Switching,
)
from binopos_ros.smoothing.scalars import (
    Number,
    anywhere,
    applied,
    beside,
    components,
    larger,
    product,
    smaller,
    vector,
)

Array = NDArray[np.float64]

#: Share of the newest interval in the time between frames, and how far it may differ.
_NEW_INTERVAL, _LONGEST_RATIO = 0.1, 3.0
#: No camera is quicker, none is slower (s).
_INTERVALS = (1e-6, 1e3)
#: Share of wrong positions right after a wrong one: they come in bursts.
_AGAIN = 0.8
#: What is near enough to a prediction to be taken without a question, in deviations.
_NEAR = 4.0
#: Wrong positions may lie anywhere from a deviation to ten thousand from the target, in each
#: decade and direction alike.
_LOG_DENSITY = -math.log(4.0 * math.pi * math.log(1e4))
_LOG_TWO_PI = math.log(2.0 * math.pi)


#: What sums over rungs, once for each axis and once for each of its rungs.
_SUM, _SUMS = np.ones(RUNGS), np.ones((RUNGS, RUNGS))
#: What takes a number of each axis to all its rungs.
_FOR_RUNGS = np.kron(np.eye(3), np.ones(RUNGS))

#: The moments of a rung: its probability, and that times those of position p and velocity v.
MOMENTS = 6
WEIGHT, P, V, PP, PV, VV = range(MOMENTS)
# Of p and v, what is multiplied for pp, pv and vv.
_LEFT, _RIGHT = np.array([0, 0, 1]), np.array([0, 1, 1])


def _motion() -> Array:
    """Return the basis of what moments become over a time: (7, MOMENTS, MOMENTS + 2).

    For 1, the time and its square, then for what the last column but one drives, white
    acceleration's part in the moments pp, pv and vv, and for the last, white velocity's in pp.
    """
    basis = np.zeros((7, MOMENTS, MOMENTS + 2))
    one, time, squared, *driven, walked = basis
    np.fill_diagonal(one, 1.0)
    time[P, V] = time[PV, VV] = 1.0
    time[PP, PV] = 2.0
    squared[PP, VV] = 1.0
    for each, moment in zip(driven, (PP, PV, VV), strict=True):
        each[moment, MOMENTS] = 1.0
    walked[PP, MOMENTS + 1] = 1.0
    return basis.reshape(7, -1)


_MOTION = _motion()


class Ladder(NamedTuple):
    """The bank's memory; R = RUNGS.

    Attributes
    ----------
    origin : (..., 3) array
        That positions in the moments are taken from, so that their squares do not swamp variances
        (m).
    moments : (..., MOMENTS, 3, R) array
        Of each axis and rung.
    variance : (..., 3, R) array
        Of the last measurement (m^2), the same for each rung.
    interval : float or (...) array
        Time between frames (s); 0 until there were two.
    since : float or (...) array
        Time since the last measurement (s).
    certainty : float or (...) array
        Probability that this was the target's, not another thing's.

    """

    origin: Array
    moments: Array
    variance: Array
    interval: Number
    since: Number
    certainty: Number


def start(position: Array, variance: Array) -> Ladder:
    """Return the bank after a first position (..., 3) of that variance (..., 3) along the axes."""
    batch = position.shape[:-1]
    moments = np.zeros((*batch, MOMENTS, 3, RUNGS))
    own = _for_rungs(variance)
    moments[..., WEIGHT, :, :] = FIRST_WEIGHTS
    moments[..., PP, :, :] = own * FIRST_WEIGHTS
    never = np.zeros(batch) if batch else 0.0
    return Ladder(position, moments, own, never, never, 1.0 + never)


def advance(ladder: Ladder, chain: Switching, elapsed: Seconds) -> Ladder:
    """Return the bank `elapsed` seconds later."""
    if anywhere(ladder.interval == 0.0):
        ladder = _with_speeds(ladder, elapsed)
    origin, moments, variance, interval, since, certainty = ladder
    batch = moments.shape[:-3]
    frames = elapsed / interval
    switch = np.exp(beside(frames, 1) * chain.rates).dot(chain.projections)
    mixed = np.empty((*batch, MOMENTS + 2, 3, RUNGS))
    flat = mixed.reshape(*batch, -1, RUNGS)
    # From the row's rung to the column's.
    np.matmul(
        moments.reshape(*batch, -1, RUNGS),
        switch.reshape(*batch, RUNGS, RUNGS),
        out=flat[..., : 3 * MOMENTS, :],
    )
    mixed[..., V, :, STANDING] = mixed[..., PV:MOMENTS, :, STANDING] = 0.0
    unit = mixed[..., WEIGHT, :, :] * variance
    np.multiply(unit, DRIVEN, out=mixed[..., MOMENTS, :, :])
    np.multiply(unit, WALKED, out=mixed[..., MOMENTS + 1, :, :])
    rate = 1.0 / interval
    gained = frames**3 / 3.0, 0.5 * rate * frames**2, frames * rate * rate, frames
    powers = vector((1.0 + 0.0 * elapsed, elapsed, elapsed * elapsed, *gained))
    motion = powers.dot(_MOTION).reshape(*batch, MOMENTS, MOMENTS + 2)
    moved = product(motion, mixed.reshape(*batch, MOMENTS + 2, 3 * RUNGS))
    moved = moved.reshape(moments.shape)
    return Ladder(origin, moved, variance, interval, since + elapsed, certainty)


def _with_speeds(ladder: Ladder, elapsed: Seconds) -> Ladder:
    """Return the bank with what two positions can say of velocities, that time apart."""
    new = ladder.interval == 0.0
    interval = _first_interval(ladder, elapsed)
    moments = ladder.moments.copy()
    speeds = moments[..., WEIGHT, :, :] * ladder.variance * FIRST_SPEEDS
    moments[..., VV, :, :] += beside(new / (interval * interval), 2) * speeds
    return ladder._replace(moments=moments, interval=interval)


def _first_interval(ladder: Ladder, elapsed: Seconds) -> Number:
    """Return the time between frames, which is that one where there were not yet two."""
    apart = smaller(larger(elapsed, _INTERVALS[0]), _INTERVALS[1])
    if isinstance(apart, float):
        return ladder.interval or apart
    return np.where(ladder.interval == 0.0, apart, ladder.interval)


def waited(ladder: Ladder, elapsed: Seconds) -> Ladder:
    """Return the bank that knows that `elapsed` seconds passed, and nothing else of it."""
    interval = _first_interval(ladder, elapsed)
    return ladder._replace(interval=interval, since=ladder.since + elapsed)


def correct(
    ladder: Ladder, position: Array, variance: Array, wrong_share: float, acceleration: Number
) -> Ladder:
    """Return the bank after a position (..., 3) of that variance (..., 3) along the axes.

    A position further from the prediction than `acceleration` (...), m/s^2, could take the target
    is weighed against one that is not the target's, of which there is a share of `wrong_share`,
    and more right after another one.
    """
    own = _for_rungs(variance)
    weights, total, *_ = _layers(ladder.moments)
    p, v, pp, pv, vv = _parted(ladder.moments)
    expected = pp + own
    off = position - ladder.origin
    apart = _for_rungs(off) - p
    mean = total.dot(_SUMS)
    shift = mean[..., 0]
    x, y, z = components(off - shift)
    # The gain is the optimal one or, on rungs that follow, 1.
    near, turn = pp / expected, pv / expected
    near[..., FOLLOWS:] = 1.0
    by_place, by_speed = near * apart, turn * apart
    after = near * own, turn * own, vv - turn * pv
    within = 0.5 * acceleration * ladder.since * ladder.since
    doubt = None
    if anywhere((abs(x) > within) | (abs(y) > within) | (abs(z) > within)):
        share = wrong_share + (1.0 - ladder.certainty) * (_AGAIN - wrong_share)
        doubt = _doubt(weights, apart, pp, own, off - shift, within, share)
    certainty: Number = 1.0 + 0.0 * ladder.since
    if doubt is None:
        weights, _ = _weighed(weights, apart, expected)
        np.maximum(weights, LEAST_WEIGHT, out=weights)
    else:
        weights, taken, certainty = doubt
        pp_after, pv_after, vv_after = after
        # Of those that take it and those that do not, each rung keeps the spread of both.
        after = (
            pp + taken * (pp_after - pp + (1.0 - taken) * by_place * by_place),
            pv + taken * (pv_after - pv + (1.0 - taken) * by_place * by_speed),
            vv + taken * (vv_after - vv + (1.0 - taken) * by_speed * by_speed),
        )
        by_place *= taken
        by_speed *= taken
    by_place += p
    by_place -= mean
    by_speed += v
    moments = _joined(weights, by_place, by_speed, *after)
    paced = in_pace(ladder)
    return Ladder(ladder.origin + shift, moments, own, paced.interval, paced.since, certainty)


def in_pace(ladder: Ladder) -> Ladder:
    """Return the bank that knows when a position came, and nothing else of it."""
    ratio = larger(ladder.since / ladder.interval, 1.0 / _LONGEST_RATIO)
    interval = ladder.interval * smaller(ratio, _LONGEST_RATIO) ** _NEW_INTERVAL
    interval = smaller(larger(interval, _INTERVALS[0]), _INTERVALS[1])
    return ladder._replace(interval=interval, since=0.0 * ladder.since)


def begun(ladder: Ladder, mean: Array, covariance: Array) -> Ladder:
    """Return a bank in which each rung begins with what another filter says.

    `mean` (..., 6) and `covariance` (..., 6, 6) are of position and velocity along the axes.
    """
    place, speed = mean[..., :3], mean[..., 3:]
    variances = covariance.diagonal(axis1=-2, axis2=-1)
    across = covariance.diagonal(offset=3, axis1=-2, axis2=-1)
    parts = (0.0 * place, speed, variances[..., :3], across, variances[..., 3:])
    spread = [_for_rungs(part) for part in parts]
    moments = _joined(np.broadcast_to(FIRST_WEIGHTS, spread[0].shape), *spread)
    moments[..., V, :, STANDING] = moments[..., PV:, :, STANDING] = 0.0
    return ladder._replace(origin=place, moments=moments, certainty=1.0 + 0.0 * ladder.since)


def _doubt(
    weights: Array,
    apart: Array,
    foretold: Array,
    own: Array,
    off: Array,
    within: Number,
    wrong_share: Number,
) -> tuple[Array, Array, Array] | None:
    """Return the rungs' probabilities after a position that may be another thing's.

    And of each rung (..., 3, R) the share of it that holds the position for the target's, and the
    certainty (...) that it is. None where the position is near enough not to be doubted.

    `apart` (..., 3, R) is what it is off each rung's prediction, `foretold` that one's variance
    and `own` (..., 3, R) the measurement's; `off` (..., 3) is what it is off the mean, and
    `within` (...) what the target may do by itself, m.
    """
    # The density of positions by their narrowest explanation says how near is near.
    density = (weights / (foretold + own)).dot(_SUM)
    distance = np.abs(off)
    reach = beside(within, 1) + _NEAR / np.sqrt(density)
    astray = np.logical_or.reduce(distance > reach, axis=-1)
    if not astray.any():
        return None
    # No rung may say that the target got further than it can.
    farthest = np.where(astray[..., None], reach * reach, np.inf)[..., None]
    seen, likelihoods = _weighed(weights, apart, np.minimum(foretold, farthest) + own)
    # Of each axis, in logarithms.
    total, least = (each[..., 0] for each in likelihoods)
    likelihood = (np.log(total) - 0.5 * (least + _LOG_TWO_PI)).sum(axis=-1)
    # In the narrowest explanation's deviations.
    radius = np.sqrt((distance * distance * density).sum(axis=-1))
    wrong = _LOG_DENSITY - 3.0 * np.log(radius) + 0.5 * np.log(density).sum(axis=-1)
    odds = np.exp(np.clip(wrong - likelihood, -700, 700))
    odds *= wrong_share / (1.0 - wrong_share)
    certainty = np.where(astray, 1.0 / (1.0 + odds), 1.0)
    sure = certainty[..., None, None]
    seen *= sure
    weights = np.maximum(seen + (1.0 - sure) * weights, LEAST_WEIGHT)
    return weights, np.minimum(seen / weights, 1.0), certainty[()]


def _weighed(weights: Array, apart: Array, variance: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return the rungs' probabilities after a position, and what its likelihood is made of.

    That is their sum in units of the best rung's, and that one's exponent, the same for each rung.
    `apart` and `variance` (..., 3, R) are what it is off each rung's prediction, and was to be.
    """
    exponent = apart * apart
    exponent /= variance
    exponent += np.log(variance)
    least = np.minimum.reduce(exponent, axis=-1, keepdims=True)
    exponent -= least
    exponent *= -0.5
    seen = np.exp(exponent, out=exponent)
    seen *= weights
    total = seen.dot(_SUMS)
    seen /= total
    return seen, (total, least)


def _layers(moments: Array) -> list[Array]:
    """Return the moments (..., MOMENTS, 3, R) one by one: views (..., 3, R)."""
    return list(moments if moments.ndim == 3 else np.moveaxis(moments, -3, 0))


def _for_rungs(vector: Array) -> Array:
    """Return the numbers of the axes (..., 3) for each of their rungs (..., 3, R)."""
    return vector.dot(_FOR_RUNGS).reshape(*vector.shape, RUNGS)


def _parted(moments: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return means of p and v of the rungs, and the variances and covariance pp, pv and vv."""
    weights, of_p, of_v, of_pp, of_pv, of_vv = _layers(moments)
    p, v = of_p / weights, of_v / weights
    pp, pv, vv = of_pp / weights, of_pv / weights, of_vv / weights
    pp -= p * p
    pv -= p * v
    vv -= v * v
    return p, v, pp, pv, vv


def _joined(weights: Array, p: Array, v: Array, pp: Array, pv: Array, vv: Array) -> Array:
    """Return the moments that come apart into these: see :func:`_parted`."""
    moments = np.empty((*weights.shape[:-2], MOMENTS, 3, RUNGS))
    of_weights, of_p, of_v, of_pp, of_pv, of_vv = _layers(moments)
    of_weights[...] = weights
    np.multiply(weights, p, out=of_p)
    np.multiply(weights, v, out=of_v)
    np.multiply(weights, pp, out=of_pp)
    np.multiply(weights, pv, out=of_pv)
    np.multiply(weights, vv, out=of_vv)
    of_pp += of_p * p
    of_pv += of_p * v
    of_vv += of_v * v
    return moments


def mean_position(ladder: Ladder) -> Array:
    """Return the position (..., 3) along the axes, over all rungs."""
    return ladder.origin + ladder.moments[..., P, :, :].dot(_SUM)


def moments(ladder: Ladder) -> tuple[Array, Array]:
    """Return means (..., 2, 3) and covariances (..., 3, 3) along the axes, over all rungs.

    In rows: position and velocity; the position's variances, covariances, the velocity's.
    """
    total = ladder.moments.dot(_SUM)
    means, spreads = total[..., P:PP, :], total[..., PP:, :]
    spreads -= means.take(_LEFT, axis=-2) * means.take(_RIGHT, axis=-2)
    means[..., 0, :] += ladder.origin
    return means, spreads


def turned(ladder: Ladder, turn: Array) -> Ladder:
    """Return the bank along axes that `turn` (..., 3, 3) makes of its own, by a small angle.

    Positions and velocities turn with the axes. Their variances stay with the axes: it is the line
    of sight that they come from, and a step turns it by next to nothing.
    """
    p, v, *spreads = _parted(ladder.moments)
    weights = ladder.moments[..., WEIGHT, :, :]
    moments = _joined(weights, product(turn, p), product(turn, v), *spreads)
    return ladder._replace(origin=applied(turn, ladder.origin), moments=moments)
