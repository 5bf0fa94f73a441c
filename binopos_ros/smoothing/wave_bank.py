"""A bank of Kalman filters for wavy water: hypotheses of the target's motion and of the waves.

Per axis the state is (p, v, a, s, u): position, velocity and acceleration of the target, and the
waves' oscillator (see :mod:`binopos_ros.smoothing.wave`) of which u adds to what is measured. The
axes are independent of each other given the hypothesis; the weights of the hypotheses are common.

still    p wanders very slowly, v = a = 0
steady   v wanders slowly, a = 0
turning  a is a Gauss-Markov process (Singer, "Estimating optimal tracking filter performance for
         manned maneuvering targets", IEEE TAES 6(4), 1970)

Each comes with the waves' oscillator at either of two frequencies, whose bands overlap: slow waves
that are taken for quick ones would be followed as motion.

The hypotheses interact as in Blom & Bar-Shalom 1988 (see opponents/multiple_models.py), with two
additions. A target that leaves a hypothesis without velocity or acceleration may have any that is
usual, so the variance of the new component enters with the share that comes from there. And a
still target either pauses or rests, so that one that has been still for long is less likely to
start: its dwell is hyper-exponential. Pausing and resting differ in nothing else, so that the
share of those that rest says it all.

Arrays have leading dimensions for batches, then the hypothesis, the component and the axis. A step
is a few products: on arrays as small as these the number of calls is what costs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing import wave_bases as bases
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.scalars import (
    Number,
    beside,
    components,
    product,
    smaller,
    smallest,
    vector,
)
from binopos_ros.smoothing.wave_bases import (
    AXES,
    COVARIANCES,
    MODELS,
    MOVING,
    SIZE,
    STATES,
    STILL,
    TURNING,
    A,
    Motion,
    P,
    S,
    U,
    V,
)

Array = NDArray[np.float64]

#: Added to every weight, so that no hypothesis is ever ruled out for good.
_LEAST_WEIGHT = 1e-12
#: Probabilities that a still target rests: one first seen, and one that has just stopped.
_RESTING_AT_FIRST, _RESTING_AFTER_STOP = 0.5, 0.3

_ONES = np.ones(MODELS)
_TOTAL = np.ones((MODELS, MODELS))
_THREE = np.ones(AXES)
# The oscillator has power below 1.6 Hz, and basins' waves have none, so the mean of a still
# target settles quicker than its hypotheses foretell: found on training sequences.
_SETTLING = np.where(bases.MOTION == 0, 0.3, 1.0)
# Takes the first hypothesis' state off.
_APART = np.eye(MODELS)
_APART[:, 0] -= 1.0
_SQUARES = MODELS * SIZE * SIZE
_OUTER_LEFT, _OUTER_RIGHT = bases.outer_places()
_WAVE_SPREAD = bases.wave_spread()
_SEEN_STATES, _SEEN_COVARIANCES = bases.seen_states(), bases.seen_covariances()
_OVER_COMPONENTS = bases.over_components()
_CONTROLLED = bases.over_hypotheses(TURNING, P)
_KINEMATIC = bases.kinematic()
# Of pairs of hypotheses, before and after: those that are still before, after, and both.
_STILL_PAIRS = np.zeros((MODELS, MODELS, 3))
_STILL_PAIRS[STILL, :, 0] = _STILL_PAIRS[:, STILL, 1] = _STILL_PAIRS[STILL, STILL, 2] = 1.0
_FLOWS = _STILL_PAIRS.reshape(-1, 3)


class Hypotheses(NamedTuple):
    """The bank's memory; M = MODELS, n = SIZE, N sequences of a batch, if any.

    Attributes
    ----------
    states : (..., M, n 3) array
        Per hypothesis: components of the axes.
    covariances : (..., M, n 3 n) array
        Of these: row, axis, column.
    weights : (..., M) array
        Probabilities of the hypotheses.
    resting : float or (N,) array
        Share of the still targets that rest.

    """

    states: Array
    covariances: Array
    weights: Array
    resting: Number


class Innovations(NamedTuple):
    """What a measurement says to each hypothesis.

    Attributes
    ----------
    apart : (..., M, 3) array
        The innovations along the axes (m).
    variance : (..., M, 3) array
        Expected of them (m^2).
    cross : (..., M, n 3) array
        Covariances of the states with them.
    distances : (..., M) array
        Sums over the axes of squared innovations by their variances.
    nearest : float or (N,) array
        The smallest of these.

    """

    apart: Array
    variance: Array
    cross: Array
    distances: Array
    nearest: Number


class Bank:
    """The arithmetic of the bank over time, from constant bases."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._exponents = bases.exponents(motion)
        polynomial, spinning = (
            bases.polynomial_transitions(motion),
            bases.spinning_transitions(motion),
        )
        # Both the transitions and their transposes: a product with a transposed view is slow.
        parts = [polynomial, polynomial.swapaxes(-1, -2), _per_axis(bases.noises(motion))]
        self._polynomial = _side_by_side(parts)
        self._spinning = _side_by_side([spinning, spinning.swapaxes(-1, -2)])
        self._entry = _per_axis(bases.entries(motion)).reshape(MODELS, COVARIANCES)
        self._switch = bases.switches(motion)[2]

    def start(self, position: Array, variance: Array, wave: Array) -> Hypotheses:
        """Return the bank after a first position (..., 3) along the axes.

        `variance` (..., 3) is the measurement's own and `wave` (..., 3) the waves', m^2.
        """
        batch = position.shape[:-1]
        states = np.zeros((*batch, MODELS, SIZE, AXES))
        states[..., P, :] = position[..., None, :]
        # Rows and columns side by side, which the memory keeps apart.
        square = np.zeros((*batch, MODELS, AXES, SIZE, SIZE))
        wave = wave[..., None, :]
        square[..., P, P] = variance[..., None, :] + wave
        square[..., S, S] = square[..., U, U] = wave
        square[..., P, U] = square[..., U, P] = -wave
        square[..., MOVING, :, V, V] = self._motion.first_speed**2
        square[..., TURNING, :, A, A] = self._motion.turn_acceleration**2
        weights = bases.WAVE_SHARES[bases.WATER]
        weights = weights / weights.sum()
        return Hypotheses(
            states.reshape(*batch, MODELS, STATES),
            square.swapaxes(-3, -2).reshape(*batch, MODELS, COVARIANCES),
            np.tile(weights, (*batch, 1)),
            np.full(batch, _RESTING_AT_FIRST) if batch else _RESTING_AT_FIRST,
        )

    def advance(self, bank: Hypotheses, wave: Array, elapsed: Seconds) -> Hypotheses:
        """Return the bank `elapsed` seconds later, with waves of variance `wave` (..., 3), m^2."""
        batch = bank.weights.shape[:-1]
        times = vector((elapsed, elapsed * bank.resting))
        powers = times[..., :1] ** bases.ORDERS
        exponents = times.dot(self._exponents)
        turns = np.exp(exponents[..., : bases.SPINS].view(np.complex128)).view(np.float64)
        decays = np.exp(exponents[..., bases.SPINS :])
        polynomial = powers.dot(self._polynomial)
        pair = polynomial[..., : 2 * _SQUARES] + turns.dot(self._spinning)
        forth = pair[..., :_SQUARES].reshape(*batch, MODELS, SIZE, SIZE)
        back = pair[..., _SQUARES:].reshape(*batch, MODELS, SIZE, SIZE)
        switch = decays[..., :-1].dot(self._switch).reshape(*batch, MODELS, MODELS)
        joint = bank.weights[..., None] * switch
        # The waves are stationary: what drives them is what the transition lets go of, so their
        # stationary spread is taken off before it and added again after it.
        spread = wave.dot(_WAVE_SPREAD).reshape(bank.covariances.shape)
        mean, covariance, weights = self._mixed(bank, joint, spread)
        moved = forth @ covariance.reshape(*batch, MODELS, SIZE, AXES * SIZE)
        moved = moved.reshape(*batch, MODELS, STATES, SIZE) @ back
        covariances = moved.reshape(*batch, MODELS, COVARIANCES)
        covariances += polynomial[..., 2 * _SQUARES :].reshape(covariances.shape)
        covariances += spread
        states = forth @ mean.reshape(*batch, MODELS, SIZE, AXES)
        resting = _resting(bank.resting, joint, decays[..., -1])
        return Hypotheses(states.reshape(mean.shape), covariances, weights, resting)

    def _mixed(self, bank: Hypotheses, joint: Array, spread: Array) -> tuple[Array, Array, Array]:
        """Return means, covariances less `spread`, and weights after the interaction.

        `joint` (..., M, M) are the probabilities of each pair, of before and after.
        """
        weights = sums(_ONES, joint)
        mixing = (joint / weights[..., None, :]).swapaxes(-1, -2)
        # About the first hypothesis' state, so that squares of positions do not swamp variances.
        apart = product(_APART, bank.states)
        moments = outer(apart, apart)
        moments += bank.covariances
        moments += self._entry
        moments -= spread
        mean, covariance = product(mixing, apart), product(mixing, moments)
        covariance -= outer(mean, mean)
        return product(mixing, bank.states), covariance, weights


def _resting(resting: Number, joint: Array, rests_on: Number) -> Number:
    """Return the share of still targets that rest, of those that stayed or came to be so."""
    before, after, stayed = components(joint.reshape(*joint.shape[:-2], -1).dot(_FLOWS))
    rested = smaller(resting * before * rests_on, stayed)
    return _RESTING_AFTER_STOP + (rested - _RESTING_AFTER_STOP * stayed) / after


def controlled(bank: Hypotheses, control: Array) -> Hypotheses:
    """Return the bank after the `control` input (..., 3), m, to the turning hypotheses."""
    change = control.dot(_CONTROLLED).reshape(bank.states.shape)
    return Hypotheses(bank.states + change, *bank[1:])


def innovations(bank: Hypotheses, position: Array, variance: Array) -> Innovations:
    """Return what a position (..., 3) of that variance (..., 3) along the axes says."""
    apart = position[..., None, :] - bank.states.dot(_SEEN_STATES)
    cross = bank.covariances.dot(_SEEN_COVARIANCES)
    expected = cross.dot(_SEEN_STATES)
    expected += variance[..., None, :]
    distances = (apart * apart / expected).dot(_THREE)
    return Innovations(apart, expected, cross, distances, smallest(distances))


def update(bank: Hypotheses, seen: Innovations, certainty: Number) -> Hypotheses:
    """Return the bank after a measurement whose weight is the `certainty`.

    A certainty below 1 stands for an innovation variance that much larger.
    """
    weight = beside(certainty, 2) / seen.variance
    gain = seen.cross * weight.dot(_OVER_COMPONENTS)
    states = bank.states + gain * seen.apart.dot(_OVER_COMPONENTS)
    covariances = bank.covariances - outer(gain, seen.cross)
    misfit = beside(certainty, 1) * (seen.distances - beside(seen.nearest, 1))
    misfit += np.log(seen.variance).dot(_THREE)
    weights = bank.weights * np.exp(-0.5 * misfit)
    weights /= weights.dot(_TOTAL)
    weights += _LEAST_WEIGHT
    return Hypotheses(states, covariances, weights, bank.resting)


def mean_position(bank: Hypotheses) -> Array:
    """Return the position (..., 3) along the axes, over all hypotheses."""
    return sums(bank.weights, bank.states[..., :AXES])


def moments(bank: Hypotheses) -> tuple[Array, Array]:
    """Return mean (..., 6) and covariance (..., 6, 6) of p and v along the axes, over all."""
    states = bank.states[..., : 2 * AXES]
    mean = sums(bank.weights, states)
    apart = states - mean[..., None, :]
    spread = product((apart * bank.weights[..., None]).swapaxes(-1, -2), apart)
    within = sums(bank.weights * _SETTLING, bank.covariances)
    spread += within.dot(_KINEMATIC).reshape(spread.shape)
    return mean, spread


def outer(left: Array, right: Array) -> Array:
    """Return x y^T (..., M, n 3 n) of each hypothesis and axis, of rows (..., M, n 3)."""
    result = left.take(_OUTER_LEFT, axis=-1)
    result *= right.take(_OUTER_RIGHT, axis=-1)
    return result


def sums(weights: Array, values: Array) -> Array:
    """Return the sums (..., k) of `values` (..., M, k) by their weights (..., M) or (M,)."""
    if values.ndim == 2:
        return weights.dot(values)
    return (weights[..., None, :] @ values)[..., 0, :]


def _per_axis(matrices: Array) -> Array:
    """Return matrices (..., n, n) as (..., n, 3, n): the same for each axis, none between them."""
    return np.repeat(matrices[..., None, :], AXES, axis=-2)


def _side_by_side(bases_of_factors: Sequence[Array]) -> Array:
    """Return bases (k, ...) of the same k factors as one (k, columns)."""
    return np.concatenate([basis.reshape(len(basis), -1) for basis in bases_of_factors], axis=1)
