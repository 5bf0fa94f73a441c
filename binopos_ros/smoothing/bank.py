"""A bank of Kalman filters: hypotheses of the target's motion, each in calm and in wavy water.

Per axis the state is (p, v, a, s, u): position, velocity and acceleration of the target, and the
waves' oscillator (see :mod:`binopos_ros.smoothing.wave`) of which u adds to what is measured. The
axes are independent of each other given the hypothesis; the weights of the hypotheses are common.

still    p wanders very slowly, v = a = 0
steady   v wanders slowly, a = 0
turning  a is a Gauss-Markov process (Singer, "Estimating optimal tracking filter performance for
         manned maneuvering targets", IEEE TAES 6(4), 1970)

Each comes in calm water, where the measurement's own covariance explains it all, and with the
waves' oscillator at either of two frequencies, whose bands overlap: slow waves that are taken for
quick ones would be followed as motion. In calm water the oscillator is not part of what is
measured and has its stationary spread, so that waves that set in may be anywhere in their swing.

The hypotheses interact as in Blom & Bar-Shalom 1988 (see opponents/multiple_models.py), with one
addition: a target that leaves a hypothesis without velocity or acceleration may have any that is
usual, so the variance of the new component enters with the share that comes from there.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.motion import Seconds

Array = NDArray[np.float64]

MOTIONS = 3
#: Of the water: calm, slow waves, quick waves.
WAVES = 3
#: Hypotheses: each motion with each of the waves.
MODELS = MOTIONS * WAVES
STILL, STEADY, TURNING = (slice(number * WAVES, (number + 1) * WAVES) for number in range(MOTIONS))
MOVING = slice(WAVES, MODELS)
CALM = slice(0, MODELS, WAVES)
SIZE = 5
P, V, A, S, U = range(SIZE)
_FLAT = 3 * SIZE * SIZE
#: Added to every weight, so that no hypothesis is ever ruled out for good.
_LEAST_WEIGHT = 1e-12
#: Probability that the water is calm at first. Waves show in two or three positions, and cost next
#: to nothing until then; a quick target in calm water that is taken for a wave costs centimetres.
_CALM_AT_FIRST = 0.95
#: Factor on the measurement's variance in calm water: ports, outlines and calibrations have small
#: errors that pixel noise does not explain, and swell is less readily taken for a target's motion.
_CALM_DOUBT = 3.0
# Whether the waves' displacement is part of what a hypothesis expects to measure.
_SEEN = np.ones((MODELS, 1, 1))
_SEEN[CALM] = 0.0
_DOUBT = np.ones((MODELS, 1))
_DOUBT[CALM] = _CALM_DOUBT
# Sums over hypotheses and axes as products: far cheaper than sum() on arrays as small as these.
_ALL = np.ones(MODELS)
_SPINS = WAVES - 1
_MINUS_HALF = np.full(3, -0.5)
_ORDERS = np.arange(6)
_EYE2 = np.eye(2)


class Hypotheses(NamedTuple):
    """The bank's memory; M = MODELS, n = SIZE.

    Attributes
    ----------
    states : (..., M, 3, n) array
        Per hypothesis and axis.
    covariances : (..., M, 3, n, n) array
        Of these.
    weights : (..., M) array
        Probabilities of the hypotheses.

    """

    states: Array
    covariances: Array
    weights: Array


@dataclasses.dataclass(frozen=True)
class Motion:
    """What the hypotheses assume; see the options of the cloud-Kalman filter for the units."""

    still_density: float
    steady_density: float
    turn_acceleration: float
    turn_time: float
    first_speed: float
    start_speed: float
    dwells: tuple[float, float, float]
    wave_frequencies: tuple[float, float]
    wave_dwell: float
    calm_dwell: float
    wave_damping: float


class Bank:
    """The arithmetic of the bank: precomputed bases, so that a step is a few small products.

    Transitions and process noises are sums of constant matrices times functions of the elapsed
    time; the sums are matrix products with the bases below.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._transition_basis = _transition_basis(motion)
        self._noise_basis = _noise_basis(motion)
        self._entry = _entry(motion)
        turn = complex(-motion.wave_damping, _damped(motion)) * 2.0 * math.pi
        spins = [turn * frequency for frequency in motion.wave_frequencies]
        rates, self._switch_basis = _switch_basis(motion)
        self._exponents = np.array([*spins, -1.0 / motion.turn_time, *rates])

    def start(self, position: Array, variance: Array, wave: Array) -> Hypotheses:
        """Return the bank after a first position (..., 3) along the axes.

        `variance` (..., 3) is the measurement's own and `wave` (..., 3) the waves', m^2.
        """
        batch = position.shape[:-1]
        states = np.zeros((*batch, MODELS, 3, SIZE))
        states[..., P] = position[..., None, :]
        covariances = np.zeros((*batch, MODELS, 3, SIZE, SIZE))
        wave = wave[..., None, :]
        covariances[..., P, P] = variance[..., None, :] + wave
        covariances[..., S, S] = covariances[..., U, U] = wave
        covariances[..., P, U] = covariances[..., U, P] = -wave
        covariances[..., MOVING, :, V, V] = self._motion.first_speed**2
        covariances[..., TURNING, :, A, A] = self._motion.turn_acceleration**2
        # Calm water: the position is where it was measured, and the waves are not part of it.
        covariances[..., CALM, :, P, P] = _CALM_DOUBT * variance[..., None, :]
        covariances[..., CALM, :, P, U] = covariances[..., CALM, :, U, P] = 0.0
        rough = 0.5 * (1.0 - _CALM_AT_FIRST)
        weights = np.tile([_CALM_AT_FIRST, rough, rough], MOTIONS) / MOTIONS
        return Hypotheses(states, covariances, np.broadcast_to(weights, (*batch, MODELS)))

    def advance(self, bank: Hypotheses, wave: Array, elapsed: Seconds) -> Hypotheses:
        """Return the bank `elapsed` seconds later, with waves of variance `wave` (..., 3), m^2."""
        time = np.asarray(elapsed)[..., None]
        exponentials = np.exp(time * self._exponents)
        real = exponentials.real
        switch = real[..., _SPINS + 1 :] @ self._switch_basis
        states, covariances, weights = self._interact(bank, switch)
        shape = (*weights.shape[:-1], MODELS, SIZE, SIZE)
        powers = time**_ORDERS
        factors = [powers[..., :2], exponentials[..., :_SPINS].imag, real[..., : _SPINS + 1]]
        back = (np.concatenate(factors, axis=-1) @ self._transition_basis).reshape(shape)
        noise = (powers @ self._noise_basis).reshape(shape)
        # The axes of a hypothesis share its transition: one product for all three of them.
        rows = (*weights.shape[:-1], MODELS, 3 * SIZE, SIZE)
        half = (covariances.reshape(rows) @ back).reshape(covariances.shape).swapaxes(-1, -2)
        moved = (half.reshape(rows) @ back).reshape(covariances.shape) + noise[..., None, :, :]
        # The waves are stationary, so what drives them is what the transition lets go of.
        spin = back[..., S:, S:]
        driving = _EYE2 - spin.swapaxes(-1, -2) @ spin
        moved[..., S:, S:] += wave[..., None, :, None, None] * driving[..., None, :, :]
        return Hypotheses(states @ back, moved, weights)

    def _interact(self, bank: Hypotheses, switch: Array) -> Hypotheses:
        """Return the bank mixed by the probabilities `switch` (..., M M), from the row's on."""
        batch = bank.weights.shape[:-1]
        joint = bank.weights[..., None] * switch.reshape(*batch, MODELS, MODELS)
        weights = _ALL @ joint
        mixing = (joint / weights[..., None, :]).swapaxes(-1, -2)
        # About the first hypothesis' state, so that squares of positions do not swamp variances.
        origin = bank.states[..., :1, :, :]
        apart = bank.states - origin
        moments = bank.covariances + apart[..., :, None] * apart[..., None, :]
        moments += self._entry
        mixed = mixing @ moments.reshape(*batch, MODELS, _FLAT)
        mean = (mixing @ apart.reshape(*batch, MODELS, 3 * SIZE)).reshape(apart.shape)
        covariances = mixed.reshape(moments.shape)
        covariances -= mean[..., :, None] * mean[..., None, :]
        return Hypotheses(mean + origin, covariances, weights)


def innovations(bank: Hypotheses, position: Array, variance: Array) -> tuple[Array, Array, Array]:
    """Return innovations (..., M, 3), their variances, and covariances with the state.

    `position` and `variance` (..., 3) are the measurement's along the axes.
    """
    states, covariances = bank.states, bank.covariances
    # In calm water u is 0 in the mean, and has no part in p.
    innovation = position[..., None, :] - states[..., P] - states[..., U]
    cross = covariances[..., P] + _SEEN * covariances[..., U]
    own = _DOUBT * variance[..., None, :]
    return innovation, cross[..., P] + cross[..., U] + own, cross


def update(
    bank: Hypotheses, innovation: Array, expected: Array, cross: Array, certainty: Array
) -> Hypotheses:
    """Return the bank after a measurement whose weight is the `certainty` (..., 1).

    A certainty below 1 stands for an innovation variance that much larger.
    """
    weight = certainty[..., None] / expected
    gain = cross * weight[..., None]
    states = bank.states + gain * innovation[..., None]
    covariances = bank.covariances - gain[..., :, None] * cross[..., None, :]
    fit = weight * innovation * innovation + np.log(expected)
    logarithm = fit @ _MINUS_HALF
    logarithm -= np.maximum.reduce(logarithm, axis=-1, keepdims=True)
    weights = bank.weights * np.exp(logarithm)
    weights = weights / (weights @ _ALL[:, None]) + _LEAST_WEIGHT
    return Hypotheses(states, covariances, weights)


def mean_position(bank: Hypotheses) -> Array:
    """Return the position (..., 3) along the axes, over all hypotheses."""
    return (bank.weights[..., None, :] @ bank.states[..., P])[..., 0, :]


def moments(bank: Hypotheses) -> tuple[Array, Array]:
    """Return mean (..., 3, 2) and covariance (..., 3, 2, 2) of p and v, over all hypotheses."""
    batch = bank.weights.shape[:-1]
    weights = bank.weights[..., None, :]
    states = bank.states[..., :A]
    mean = (weights @ states.reshape(*batch, MODELS, 6)).reshape(*batch, 3, 2)
    apart = states - mean[..., None, :, :]
    spread = bank.covariances[..., :A, :A] + apart[..., :, None] * apart[..., None, :]
    spread = weights @ spread.reshape(*batch, MODELS, 12)
    return mean, spread.reshape(*batch, 3, 2, 2)


def _damped(motion: Motion) -> float:
    return math.sqrt(1.0 - motion.wave_damping**2)


def _transition_basis(motion: Motion) -> Array:
    """Return the basis (3 + 2 x 2, M n n) of the transitions' transposes.

    For 1 and t, imaginary and then real parts of exp((-zeta + i damped) omega t), and
    exp(-t / turn_time).
    """
    tau = motion.turn_time
    basis = np.zeros((3 + 2 * _SPINS, MODELS, SIZE, SIZE))
    one, time, fading = basis[0], basis[1], basis[-1]
    one[:, P, P] = 1.0
    one[MOVING, V, V] = time[MOVING, P, V] = 1.0
    # Singer: v += tau (1 - e) a; p += tau (t - tau (1 - e)) a.
    one[TURNING, V, A], fading[TURNING, V, A] = tau, -tau
    one[TURNING, P, A], time[TURNING, P, A], fading[TURNING, P, A] = -tau * tau, tau, tau * tau
    fading[TURNING, A, A] = 1.0
    # The oscillator of wave.py, taken apart into decayed cosine and sine.
    unit = 1.0 / _damped(motion)
    slant = motion.wave_damping * unit
    for wave in range(_SPINS):
        models = slice(wave + 1, MODELS, WAVES)
        sine, cosine = basis[2 + wave, models], basis[2 + _SPINS + wave, models]
        cosine[:, S, S] = cosine[:, U, U] = 1.0
        sine[:, S, S], sine[:, U, U] = slant, -slant
        sine[:, S, U], sine[:, U, S] = unit, -unit
    return basis.swapaxes(-1, -2).reshape(len(basis), -1)


def _noise_basis(motion: Motion) -> Array:
    """Return the basis (6, M n n) of the motions' noises, for 1, t, t^2, ... t^5."""
    basis = np.zeros((6, MODELS, SIZE, SIZE))
    basis[1, STILL, P, P] = motion.still_density
    # White acceleration of a density, and white jerk that keeps the acceleration's variance.
    for models, density, chain in (
        (STEADY, motion.steady_density, (V, P)),
        (TURNING, 2.0 * motion.turn_acceleration**2 / motion.turn_time, (A, V, P)),
    ):
        for low, row in enumerate(chain):
            for high, column in enumerate(chain):
                order = low + high + 1
                divisor = math.factorial(low) * math.factorial(high) * order
                basis[order, models, row, column] = density / divisor
    return basis.reshape(len(basis), -1)


def _switch_basis(motion: Motion) -> tuple[Array, Array]:
    """Return rates (M,) and basis (M, M M): switch probabilities are exp(rates t) @ basis.

    The hypotheses follow a Markov chain in continuous time: each motion is left after its mean
    dwell, for any of the others alike, and so are calm water and each of the waves. Such a chain
    is reversible, so its eigenvalues are real.
    """
    waves = np.array([[0.0, 0.5, 0.5], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) / motion.calm_dwell
    waves[1, 2] = waves[2, 1] = 1.0 / motion.wave_dwell
    waves -= np.diag(waves.sum(axis=1))
    leaving = 1.0 / np.array(motion.dwells)[:, None]
    motions = leaving * (np.full((MOTIONS, MOTIONS), 1.0 / (MOTIONS - 1)) - _wide(MOTIONS))
    generator = np.kron(motions, np.eye(WAVES)) + np.kron(np.eye(MOTIONS), waves)
    rates, right = np.linalg.eig(generator)
    left = np.linalg.inv(right)
    basis = right.T[:, :, None] * left[:, None, :]
    return rates.real, basis.real.reshape(MODELS, -1)


def _wide(count: int) -> Array:
    """Return the diagonal that makes the rows of a generator add up to nothing."""
    return count / (count - 1) * np.eye(count)


def _entry(motion: Motion) -> Array:
    """Return the variances (M, 1, n, n) of the components that a hypothesis lacks.

    They reach only the hypotheses that have the component: the others' transitions drop it.
    """
    entry = np.zeros((MODELS, 1, SIZE, SIZE))
    entry[STILL, :, V, V] = motion.start_speed**2
    entry[STILL, :, A, A] = entry[STEADY, :, A, A] = motion.turn_acceleration**2
    return entry
