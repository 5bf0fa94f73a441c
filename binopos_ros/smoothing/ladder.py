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

Arrays have leading dimensions for batches, then the axis, the rung and the component.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.chain import eigenbasis
from binopos_ros.smoothing.motion import Seconds

Array = NDArray[np.float64]

#: Manoeuvring indices of the rungs: at rest, steady, and a decade each. A target at rest has no
#: velocity.
INDICES = np.array([0.0, 0.0, *(10.0**decade for decade in range(-5, 8))])
RUNGS = INDICES.size
REST = 0
#: Frames for which a target stays on a rung in the mean: longer where it is steady, as the lower
#: rungs are told from each other the later.
_DWELLS = np.where(INDICES < 0.1, 100.0, 20.0)
_DWELLS[REST], _DWELLS[REST + 1] = 40.0, 200.0
#: A rung further is that much rarer.
_FARTHER = 0.5
#: Deviation of the velocity at first on a rung, in those that it gains in a frame.
_FIRST_SPEED = 10.0
#: Of a velocity of which a rung itself says nothing, per frame, in deviations of the measurement.
_LEAST_FIRST_SPEED = 1.0
#: From here on the gain of the position is above 0.97: taken for 1, so that nothing lags.
_FOLLOWS = INDICES >= 100.0
#: Share of the newest interval in the time between frames, and how far it may differ.
_NEW_INTERVAL, _LONGEST_RATIO = 0.1, 3.0
#: No camera is quicker, none is slower (s).
_INTERVALS = (1e-6, 1e3)
#: No rung is ever ruled out for good.
_LEAST_WEIGHT = 1e-12
#: What is near enough to a prediction to be taken without a question, in deviations.
_NEAR = 4.0
#: Wrong positions may lie anywhere from a deviation to ten thousand from the target, in each
#: decade alike.
_LOG_DENSITY = -math.log(2.0 * math.log(1e4))
_LOG_TWO_PI = math.log(2.0 * math.pi)

# Squares of position and velocity, and their product.
_LEFT, _RIGHT = np.array([0, 0, 1]), np.array([0, 1, 1])
_FIRST_SPEEDS = np.maximum((_FIRST_SPEED**2) * INDICES, _LEAST_FIRST_SPEED**2)
_FIRST_SPEEDS[REST] = 0.0


def _generator() -> Array:
    """Return the rates (R, R) per frame at which a target changes from rung to rung."""
    apart = np.abs(np.subtract.outer(np.arange(RUNGS), np.arange(RUNGS)))
    shares = np.where(apart == 0, 0.0, _FARTHER**apart)
    rates = shares / shares.sum(axis=1, keepdims=True) / _DWELLS[:, None]
    return rates - np.diag(rates.sum(axis=1))


_RATES, _SWITCHES = eigenbasis(_generator())
_SWITCHES = _SWITCHES.reshape(RUNGS, -1)


class Ladder(NamedTuple):
    """The bank's memory; R = RUNGS.

    Attributes
    ----------
    states : (..., 3, R, 2) array
        Position (m) and velocity (m/s) on each rung.
    covariances : (..., 3, R, 3) array
        Of these: position, both, velocity.
    weights : (..., 3, R) array
        Probabilities of the rungs.
    variance : (..., 3) array
        Of the last measurement (m^2).
    interval : (...) array
        Time between frames (s); 0 until there were two.
    since : (...) array
        Time since the last measurement (s).

    """

    states: Array
    covariances: Array
    weights: Array
    variance: Array
    interval: Array
    since: Array


def start(position: Array, variance: Array) -> Ladder:
    """Return the bank after a first position (..., 3) of that variance (..., 3) along the axes."""
    batch = position.shape[:-1]
    states = np.zeros((*batch, 3, RUNGS, 2))
    states[..., 0] = position[..., None]
    covariances = np.zeros((*batch, 3, RUNGS, 3))
    covariances[..., 0] = variance[..., None]
    weights = np.full((*batch, 3, RUNGS), 1.0 / RUNGS)
    return Ladder(states, covariances, weights, variance, np.zeros(batch), np.zeros(batch))


def advance(ladder: Ladder, elapsed: Seconds) -> Ladder:
    """Return the bank `elapsed` seconds later."""
    elapsed = np.asarray(elapsed)
    interval, covariances = ladder.interval, ladder.covariances
    new = interval == 0.0
    if np.any(new):
        # Of the velocity is known what two positions can say of it.
        interval = np.where(new, np.clip(elapsed, *_INTERVALS), interval)
        per_frame = (ladder.variance / (interval * interval)[..., None])[..., None]
        speeds = np.where(new[..., None, None], per_frame * _FIRST_SPEEDS, covariances[..., 2])
        covariances = np.concatenate([covariances[..., :2], speeds[..., None]], axis=-1)
    frames = (elapsed / interval)[..., None]
    switch = np.exp(frames * _RATES).dot(_SWITCHES)
    switch = (
        switch.reshape(*frames.shape, RUNGS, RUNGS)
        if frames.ndim > 1
        else switch.reshape(1, RUNGS, RUNGS)
    )
    joint = ladder.weights[..., None] * switch
    weights = joint.sum(axis=-2)
    mixing = (joint / weights[..., None, :]).swapaxes(-1, -2)
    # About the first rung's state, so that squares of positions do not swamp variances.
    apart = ladder.states - ladder.states[..., :1, :]
    moments = covariances + apart[..., _LEFT] * apart[..., _RIGHT]
    mixed = mixing @ np.concatenate([apart, moments], axis=-1)
    mean, moments = mixed[..., :2], mixed[..., 2:]
    moments = moments - mean[..., _LEFT] * mean[..., _RIGHT]
    states = mean + ladder.states[..., :1, :]
    states[..., REST, 1] = 0.0
    moments[..., REST, 1:] = 0.0
    time = elapsed[..., None, None]
    moved = np.empty_like(states)
    moved[..., 0] = states[..., 0] + time * states[..., 1]
    moved[..., 1] = states[..., 1]
    driven = INDICES * (ladder.variance / interval[..., None])[..., None]
    ratio = frames[..., None]
    a, b, c = moments[..., 0], moments[..., 1], moments[..., 2]
    spread = np.empty_like(moments)
    drift = driven * ratio
    spread[..., 2] = c + drift / interval[..., None, None]
    spread[..., 1] = b + time * c + 0.5 * drift * ratio
    spread[..., 0] = a + time * (2.0 * b + time * c) + drift * ratio * time / 3.0
    return Ladder(moved, spread, weights, ladder.variance, interval, ladder.since + elapsed)


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
    ladder: Ladder, position: Array, variance: Array, wrong_share: float, acceleration: float
) -> Reading:
    """Return the bank after a position (..., 3) of that variance (..., 3) along the axes.

    A position further from the prediction than `acceleration` (m/s^2) could take the target is
    weighed against one that is not the target's, of which there is a share of `wrong_share`.
    """
    p, a, b = ladder.states[..., 0], ladder.covariances[..., 0], ladder.covariances[..., 1]
    expected = a + variance[..., None]
    apart = position[..., None] - p
    squares = apart * apart / expected
    exponent = -0.5 * (squares + np.log(expected))
    best = exponent.max(axis=-1, keepdims=True)
    seen = ladder.weights * np.exp(exponent - best)
    total = seen.sum(axis=-1, keepdims=True)
    # The density of positions by their narrowest explanation says how near is near.
    narrow = np.sqrt(1.0 / (ladder.weights / expected).sum(axis=-1))
    distance = np.abs((ladder.weights * apart).sum(axis=-1))
    since = ladder.since[..., None]
    far = distance > 0.5 * acceleration * since * since + _NEAR * narrow
    certainty = np.ones(far.shape[:-1])
    if np.any(far):
        likelihood = np.log(total[..., 0]) + best[..., 0] - 0.5 * _LOG_TWO_PI
        wrong = _LOG_DENSITY - np.log(np.maximum(distance, narrow))
        odds = wrong_share / (1.0 - wrong_share) * np.exp(np.clip(wrong - likelihood, -700, 700))
        certainty = np.where(far, 1.0 / (1.0 + odds), 1.0).min(axis=-1)
    sure = certainty[..., None, None]
    chosen = sure * (seen / total)
    weights = np.maximum(chosen + (1.0 - sure) * ladder.weights, _LEAST_WEIGHT)
    # Of each rung the share of it that holds the position for the target's.
    taken = np.minimum(chosen / weights, 1.0)
    own = variance[..., None]
    near, turn = np.where(_FOLLOWS, 1.0, a / expected), b / expected
    gained = taken * apart
    states = np.empty_like(ladder.states)
    states[..., 0] = p + near * gained
    states[..., 1] = ladder.states[..., 1] + turn * gained
    # Joseph's form, as the gain of those that follow is not the optimal one.
    apart = apart - gained
    moved = gained * apart
    kept = 1.0 - near
    covariances = np.empty_like(ladder.covariances)
    covariances[..., 0] = (
        a + taken * (kept * kept * a + near * near * own - a) + near * near * moved
    )
    covariances[..., 1] = (
        b + taken * (kept * (b - turn * a) + near * turn * own - b) + near * turn * moved
    )
    covariances[..., 2] = ladder.covariances[..., 2] + turn * turn * (moved - taken * expected)
    interval = ladder.interval
    ratio = np.clip(ladder.since / interval, 1.0 / _LONGEST_RATIO, _LONGEST_RATIO)
    interval = np.clip(interval * ratio**_NEW_INTERVAL, *_INTERVALS)
    after = Ladder(states, covariances, weights, variance, interval, 0.0 * ladder.since)
    return Reading(after, certainty)


def mean_position(ladder: Ladder) -> Array:
    """Return the position (..., 3) along the axes, over all rungs."""
    weights = ladder.weights
    return (weights * ladder.states[..., 0]).sum(axis=-1) / weights.sum(axis=-1)


def moments(ladder: Ladder) -> tuple[Array, Array]:
    """Return mean (..., 3, 2) and covariance (..., 3, 3) of p and v along the axes, over all.

    The covariance of each axis is that of the position, of both, and of the velocity.
    """
    share = (ladder.weights / ladder.weights.sum(axis=-1, keepdims=True))[..., None, :]
    first = ladder.states[..., :1, :]
    apart = ladder.states - first
    spread = ladder.covariances + apart[..., _LEFT] * apart[..., _RIGHT]
    summed = (share @ np.concatenate([apart, spread], axis=-1))[..., 0, :]
    mean, spread = summed[..., :2], summed[..., 2:]
    return mean + first[..., 0, :], spread - mean[..., _LEFT] * mean[..., _RIGHT]


def turned(ladder: Ladder, turn: Array) -> Ladder:
    """Return the bank along axes that `turn` (..., 3, 3) makes of its own, by a small angle.

    Positions and velocities turn with the axes. Their variances stay with the axes: it is the line
    of sight that they come from, and a step turns it by next to nothing.
    """
    flat = ladder.states.reshape(*ladder.states.shape[:-2], -1)
    return ladder._replace(states=(turn @ flat).reshape(ladder.states.shape))
