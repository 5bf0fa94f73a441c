"""The hypotheses of the bank, and the constant matrices that its arithmetic is made of.

Transitions, process noises and switches of hypotheses are sums of constant matrices times
functions of the elapsed time: its powers, decays and damped turns. So a step takes a few small
products whatever its time, and nothing is cached.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.chain import eigenbasis

Array = NDArray[np.float64]

#: Of the target: still, steady, turning.
MOTIONS = 3
#: Of the water.
WAVES = 3
SLOW, QUICK, SWELL = range(WAVES)
#: The motion and the water of each hypothesis: swell for still targets alone.
MOTION = np.array([0, 0, 0, 1, 1, 2, 2])
WATER = np.array([SLOW, QUICK, SWELL, SLOW, QUICK, SLOW, QUICK])
MODELS = MOTION.size
STILL, STEADY, TURNING = slice(0, 3), slice(3, 5), slice(5, 7)
MOVING = slice(3, 7)
#: What waves are at first, and how often they change to each: swell is rare.
WAVE_SHARES = np.array([0.4995, 0.4995, 0.001])
#: Components of the state of an axis.
SIZE = 5
P, V, A, S, U = range(SIZE)
AXES = 3
#: A hypothesis' states, and their covariances, as rows.
STATES = SIZE * AXES
COVARIANCES = SIZE * AXES * SIZE
#: Powers of the elapsed time.
ORDERS = np.arange(6.0)
#: Real and imaginary parts of what turns or fades within a hypothesis.
SPINS = 2 * (WAVES + 1)


@dataclasses.dataclass(frozen=True)
class Motion:
    """What the hypotheses assume of targets in a basin and of its waves.

    Found by the tuning of `bench/tune_filters.py` on basins' waves of 1.6 to 6 Hz, but for the
    dwells of pauses and rests and for the swell.

    Attributes
    ----------
    still_density : float
        Growth of the variance of a still target (m^2/s).
    steady_density : float
        Acceleration density of a steady target (m^2/s^3).
    turn_acceleration, turn_time : float
        Deviation of a turning target's acceleration (m/s^2), and the time that it lasts (s).
    first_speed, start_speed : float
        Deviations of the velocity of a target first seen, and of a still one that starts (m/s).
    pause_dwell, rest_dwell, steady_dwell, turn_dwell : float
        Mean times that a target pauses, rests, is steady and turns (s).
    wave_frequencies, wave_dampings : tuple of float
        Of slow and quick waves and of swell (Hz, damping ratios).
    wave_dwell : float
        Mean time that waves stay slow or quick (s).

    """

    still_density: float = 5.215e-10
    steady_density: float = 1.114e-7
    turn_acceleration: float = 0.2243
    turn_time: float = 0.4048
    first_speed: float = 0.2009
    start_speed: float = 0.003
    pause_dwell: float = 2.0
    rest_dwell: float = 100.0
    steady_dwell: float = 8.496
    turn_dwell: float = 0.538
    wave_frequencies: tuple[float, ...] = (1.93, 3.48, 1.1)
    wave_dampings: tuple[float, ...] = (0.2112, 0.2112, 0.08)
    wave_dwell: float = 18.14


def exponents(motion: Motion) -> Array:
    """Return the basis (2, SPINS + rates) of exponents, for the time and the resting time.

    The first are the waves' turns and the acceleration's decay, real and imaginary parts in turn;
    then come the rates of the :func:`switches`, and that at which rest ends. The resting time is
    the time times the share that rests.
    """
    waves = zip(motion.wave_frequencies, motion.wave_dampings, strict=True)
    turns = [2.0 * math.pi * each * complex(-zeta, _damped(zeta)) for each, zeta in waves]
    spins = np.array([*turns, -1.0 / motion.turn_time])
    rates, patience, _ = switches(motion)
    basis = np.zeros((2, SPINS + rates.size + 1))
    basis[0] = np.concatenate([spins.view(np.float64), rates, [-1.0 / motion.rest_dwell]])
    basis[1, SPINS:-1] = patience
    return basis


def polynomial_transitions(motion: Motion) -> Array:
    """Return the basis (6, M, n, n) of the transitions' part in powers of time."""
    tau = motion.turn_time
    basis = np.zeros((ORDERS.size, MODELS, SIZE, SIZE))
    one, time = basis[0], basis[1]
    one[:, P, P] = 1.0
    one[MOVING, V, V] = time[MOVING, P, V] = 1.0
    # Singer: v += tau (1 - e) a; p += tau (t - tau (1 - e)) a.
    one[TURNING, V, A] = tau
    one[TURNING, P, A], time[TURNING, P, A] = -tau * tau, tau
    return basis


def spinning_transitions(motion: Motion) -> Array:
    """Return the basis (SPINS, M, n, n) of the rest, for parts of the turns and the decay."""
    basis = np.zeros((WAVES + 1, 2, MODELS, SIZE, SIZE))
    # The oscillator of wave.py, taken apart into decayed cosine and sine.
    for wave, damping in enumerate(motion.wave_dampings):
        unit = 1.0 / _damped(damping)
        slant = damping * unit
        for model in np.flatnonzero(wave == WATER):
            cosine, sine = basis[wave, :, model]
            cosine[S, S] = cosine[U, U] = 1.0
            sine[S, S], sine[U, U] = slant, -slant
            sine[S, U], sine[U, S] = unit, -unit
    fading, tau = basis[-1, 0, TURNING], motion.turn_time
    fading[:, V, A], fading[:, P, A], fading[:, A, A] = -tau, tau * tau, 1.0
    return basis.reshape(SPINS, MODELS, SIZE, SIZE)


def noises(motion: Motion) -> Array:
    """Return the basis (6, M, n, n) of the motions' process noises in powers of time."""
    basis = np.zeros((ORDERS.size, MODELS, SIZE, SIZE))
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
    return basis


def entries(motion: Motion) -> Array:
    """Return the variances (M, n, n) of the components that a hypothesis lacks.

    They reach only the hypotheses that have the component: the others' transitions drop it.
    """
    entry = np.zeros((MODELS, SIZE, SIZE))
    entry[STILL, V, V] = motion.start_speed**2
    entry[STILL, A, A] = entry[STEADY, A, A] = motion.turn_acceleration**2
    return entry


def switches(motion: Motion) -> tuple[Array, Array, Array]:
    """Return rates (2 M,), 1/s, their patience (2 M,) and the basis (2 M, M M) of the switches.

    Switch probabilities, from the row's hypothesis on, are exp((rates + resting patience) t) @
    basis. The hypotheses follow a Markov chain in continuous time: each motion is left after its
    mean dwell, for any of the others alike, and so are the waves. Such a chain is reversible, so
    its eigenvalues are real. For a still target that rests, motions pass more slowly: its rows
    are those of a shorter time.
    """
    waves = np.tile(2.0 * WAVE_SHARES / motion.wave_dwell, (WAVES, 1))
    np.fill_diagonal(waves, 0.0)
    waves -= np.diag(waves.sum(axis=1))
    leaving = 1.0 / np.array([motion.pause_dwell, motion.steady_dwell, motion.turn_dwell])[:, None]
    motions = leaving * (np.full((MOTIONS, MOTIONS), 0.5) - 1.5 * np.eye(MOTIONS))
    (fast, motion_basis), (slow, wave_basis) = eigenbasis(motions), eigenbasis(waves)
    # From hypothesis (motion i, wave k) to (j, l), for each pair of eigenvalues.
    pairs = np.einsum('aij,bkl->abikjl', motion_basis, wave_basis)
    pairs = pairs.reshape(MOTIONS * WAVES, MOTIONS * WAVES, -1)[:, MOTION * WAVES + WATER]
    folded = pairs @ _folding()
    basis = np.zeros((2, len(pairs), MODELS, MODELS))
    basis[0, :, STILL], basis[1, :, MOVING] = folded[:, STILL], folded[:, MOVING]
    rates = (fast[:, None] + slow).ravel()
    patience = np.repeat(fast, WAVES) * (motion.pause_dwell / motion.rest_dwell - 1.0)
    return (
        np.tile(rates, 2),
        np.concatenate([patience, np.zeros(patience.size)]),
        basis.reshape(rates.size * 2, -1),
    )


def outer_places() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return places (n 3 n,) L, R in rows x, y of (n 3,): x[L] * y[R] is x y^T of each axis.

    The result is (n, 3, n): row, axis, column of each axis' product.
    """
    places = np.arange(STATES).reshape(SIZE, AXES)
    left = np.broadcast_to(places[:, :, None], (SIZE, AXES, SIZE))
    right = np.broadcast_to(places.T, (SIZE, AXES, SIZE))
    return left.ravel(), right.ravel()


def wave_spread() -> Array:
    """Return the basis (3, M n 3 n): covariances of waves of the axes' variances."""
    basis = np.zeros((AXES, MODELS, SIZE, AXES, SIZE))
    for axis in range(AXES):
        basis[axis, :, S, axis, S] = basis[axis, :, U, axis, U] = 1.0
    return basis.reshape(AXES, -1)


def seen_states() -> Array:
    """Return the basis (n 3, 3) that makes what is measured of states: p + u."""
    basis = np.zeros((SIZE, AXES, AXES))
    basis[P] = basis[U] = np.eye(AXES)
    return basis.reshape(STATES, -1)


def seen_covariances() -> Array:
    """Return the basis (n 3 n, n 3): covariances of the states with what is measured of them."""
    basis = np.zeros((SIZE, AXES, SIZE, SIZE, AXES))
    for row in range(SIZE):
        basis[row, :, P, row] = basis[row, :, U, row] = np.eye(AXES)
    return basis.reshape(COVARIANCES, -1)


def over_components() -> Array:
    """Return the basis (3, n 3) that takes what the axes have to each component."""
    return np.tile(np.eye(AXES), (1, SIZE))


def over_hypotheses(models: slice, component: int) -> Array:
    """Return the basis (3, M n 3) that takes what the axes have to a component of `models`."""
    basis = np.zeros((AXES, MODELS, SIZE, AXES))
    basis[:, models, component] = np.eye(AXES)[:, None, :]
    return basis.reshape(AXES, -1)


def kinematic() -> Array:
    """Return the basis (n 3 n, 36) that takes p and v out of covariances, as (6, 6)."""
    basis = np.zeros((SIZE, AXES, SIZE, 2, AXES, 2, AXES))
    for axis in range(AXES):
        for row in (P, V):
            for column in (P, V):
                basis[row, axis, column, row, axis, column, axis] = 1.0
    return basis.reshape(COVARIANCES, -1)


def _folding() -> Array:
    """Return the matrix (MOTIONS WAVES, M) from pairs of motion and water to the hypotheses.

    A target that leaves stillness, the only hypothesis of swell, finds itself in slow waves.
    """
    folding = np.zeros((MOTIONS, WAVES, MODELS))
    folding[MOTION, WATER, np.arange(MODELS)] = 1.0
    folding[1:, SWELL] = folding[1:, SLOW]
    return folding.reshape(-1, MODELS)


def _damped(damping: float) -> float:
    return math.sqrt(1.0 - damping * damping)
