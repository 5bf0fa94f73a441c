"""The bank's arithmetic against matrix exponentials, and the wave model against its theory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from binopos_ros.smoothing.wave import oscillator
from binopos_ros.smoothing.wave_bank import Bank, Hypotheses, innovations, moments, update
from binopos_ros.smoothing.wave_bases import (
    MODELS,
    MOTION,
    MOVING,
    SIZE,
    STEADY,
    STILL,
    TURNING,
    WATER,
    WAVE_SHARES,
    Motion,
)

ASSUMED = Motion(
    still_density=1e-9,
    steady_density=1e-4,
    turn_acceleration=0.3,
    turn_time=50.0,
    first_speed=0.2,
    start_speed=0.05,
    pause_dwell=1e12,
    rest_dwell=1e12,
    steady_dwell=1e12,
    turn_dwell=1e12,
    wave_frequencies=(2.0, 3.0, 1.2),
    wave_dwell=1e12,
    wave_dampings=(0.25, 0.25, 0.1),
)
WEIGHTS = np.array([0.15, 0.05, 0.1, 0.25, 0.1, 0.15, 0.2])
WAVE = np.array([1e-6, 2e-6, 4e-5])
OMEGAS = 2.0 * np.pi * np.array(ASSUMED.wave_frequencies)
STEADY_QUICK, TURNING_SLOW, STILL_SWELL = STEADY.start + 1, TURNING.start, STILL.start + 2


def bank_of(states, covariances, weights, resting=0.5):
    """Return the memory of states (M, 3, n) and covariances (M, 3, n, n)."""
    return Hypotheses(
        states.swapaxes(-1, -2).reshape(MODELS, -1),
        covariances.swapaxes(1, 2).reshape(MODELS, -1),
        weights,
        resting,
    )


def states_of(bank):
    return bank.states.reshape(MODELS, SIZE, 3).swapaxes(-1, -2)


def covariances_of(bank):
    return bank.covariances.reshape(MODELS, SIZE, 3, SIZE).swapaxes(1, 2)


def continuous(model):
    """Return drift and noise density (5, 5) of a hypothesis, waves of unit variance."""
    drift, density = np.zeros((5, 5)), np.zeros((5, 5))
    if model == STILL_SWELL:
        density[0, 0] = ASSUMED.still_density
    elif model == STEADY_QUICK:
        drift[0, 1] = 1.0
        density[1, 1] = ASSUMED.steady_density
    else:
        drift[0, 1] = 1.0
        drift[1, 2] = 1.0
        drift[2, 2] = -1.0 / ASSUMED.turn_time
        density[2, 2] = 2.0 * ASSUMED.turn_acceleration**2 / ASSUMED.turn_time
    omega, damping = OMEGAS[WATER[model]], ASSUMED.wave_dampings[WATER[model]]
    drift[3, 4] = omega
    drift[4, 3] = -omega
    drift[4, 4] = -2.0 * damping * omega
    density[4, 4] = 4.0 * damping * omega
    return drift, density


def van_loan(drift, density, time):
    """Return transition and noise over `time`: Van Loan, IEEE TAC 23(3), 1978."""
    size = len(drift)
    block = expm(np.block([[-drift, density], [np.zeros_like(drift), drift.T]]) * time)
    psi = block[size:, size:].T
    return psi, psi @ block[:size, size:]


def test_oscillator_has_unit_covariance_and_no_power_at_zero_frequency():
    drift, density = (matrix[3:, 3:] for matrix in continuous(STEADY_QUICK))
    np.testing.assert_allclose(solve_continuous_lyapunov(drift, -density), np.eye(2), atol=1e-12)
    # The integral of u over all time of the autocorrelation e2' exp(A t) e2 is -e2' A^-1 e2.
    assert np.linalg.inv(drift)[1, 1] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize('time', [1e-3, 1 / 30, 0.4])
def test_oscillator_is_the_exponential_of_its_drift(time):
    drift, _ = continuous(STEADY_QUICK)
    expected = expm(drift[3:, 3:] * time)
    np.testing.assert_allclose(oscillator(OMEGAS[1], 0.25, time), expected, atol=1e-12)


@pytest.mark.parametrize('model', [STILL_SWELL, STEADY_QUICK, TURNING_SLOW])
@pytest.mark.parametrize('time', [1e-2, 1 / 30, 0.2])
def test_prediction_of_a_hypothesis_is_the_exact_discretisation(model, time):
    random = np.random.default_rng(model)
    states = np.zeros((MODELS, 3, SIZE))
    states[model] = random.normal(size=(3, SIZE))
    root = random.normal(size=(SIZE, SIZE)) * 0.01
    absent = {STILL_SWELL: [1, 2], STEADY_QUICK: [2]}.get(model, [])
    states[model][:, absent] = 0.0
    root[absent] = 0.0
    covariances = np.tile(root @ root.T, (MODELS, 3, 1, 1))
    start = bank_of(states, covariances, np.full(MODELS, 1.0 / MODELS))
    ahead = Bank(ASSUMED).advance(start, WAVE, time)
    drift, density = continuous(model)
    for axis in range(3):
        scale = np.ones(5)
        scale[3:] = np.sqrt(WAVE[axis])
        psi, noise = van_loan(drift, density * np.outer(scale, scale), time)
        np.testing.assert_allclose(
            states_of(ahead)[model, axis], psi @ states[model, axis], rtol=1e-4, atol=1e-9
        )
        expected = psi @ covariances[model, axis] @ psi.T + noise
        found = covariances_of(ahead)[model, axis]
        if model == STILL_SWELL:
            # What a target has that starts is of no account to those that stay.
            expected[[1, 2]] = expected[:, [1, 2]] = 0.0
        np.testing.assert_allclose(found, expected, rtol=2e-2, atol=1e-9)


def test_still_target_forgets_velocity_and_acceleration():
    states = np.ones((MODELS, 3, SIZE))
    covariances = np.tile(np.eye(SIZE), (MODELS, 3, 1, 1))
    start = bank_of(states, covariances, (MOTION == 0) / 3.0)
    ahead = states_of(Bank(ASSUMED).advance(start, WAVE, 0.1))
    assert np.all(ahead[STILL, :, 1:3] == 0.0)
    np.testing.assert_allclose(ahead[STILL, :, 0], 1.0, rtol=1e-12)


LIVELY = dataclasses.replace(
    ASSUMED,
    pause_dwell=1.0,
    rest_dwell=1.0,
    steady_dwell=2.0,
    turn_dwell=0.5,
    wave_dwell=3.0,
)


def test_switching_is_a_markov_chain_in_continuous_time():
    states = np.zeros((MODELS, 3, SIZE))
    covariances = np.tile(1e-12 * np.eye(SIZE), (MODELS, 3, 1, 1))
    start, bank = bank_of(states, covariances, WEIGHTS), Bank(LIVELY)
    slow, quick, swell = WAVE_SHARES
    # From slow, quick, swell to slow, quick, swell.
    water = np.array(
        [
            [0.0, 2.0 * quick / 3.0, 2.0 * swell / 3.0],
            [2.0 * slow / 3.0, 0.0, 2.0 * swell / 3.0],
            [2.0 * slow / 3.0, 2.0 * quick / 3.0, 0.0],
        ]
    )
    motion = np.array([[0.0, 0.5, 0.5], [0.25, 0.0, 0.25], [1.0, 1.0, 0.0]])
    generator = np.kron(motion, np.eye(3)) + np.kron(np.eye(3), water)
    generator -= np.diag(generator.sum(axis=1))
    # All pairs of motion and water, then those of moving targets in swell counted to slow waves.
    pairs = np.zeros(9)
    pairs[3 * MOTION + WATER] = WEIGHTS
    pairs = (pairs @ expm(0.7 * generator)).reshape(3, 3)
    pairs[1:, 0] += pairs[1:, 2]
    ahead = bank.advance(start, WAVE, 0.7)
    np.testing.assert_allclose(ahead.weights, pairs[MOTION, WATER], atol=1e-12)
    twice = bank.advance(bank.advance(start, WAVE, 0.3), WAVE, 0.4)
    np.testing.assert_allclose(twice.weights, ahead.weights, atol=0.01)


def test_still_target_that_pauses_or_rests_is_a_chain_with_both():
    uneven = dataclasses.replace(LIVELY, rest_dwell=40.0)
    bank = Bank(uneven)
    states = np.zeros((MODELS, 3, SIZE))
    covariances = np.tile(1e-12 * np.eye(SIZE), (MODELS, 3, 1, 1))
    now = bank_of(states, covariances, (MOTION == 0) / 3.0)
    # Paused, resting, steady, turning; three of ten that stop come to rest.
    after = np.array([0.7, 0.3])
    generator = np.zeros((4, 4))
    generator[0, 2:], generator[1, 2:] = 0.5, 0.5 / 40.0
    generator[2, :2], generator[2, 3] = 0.25 * after, 0.25
    generator[3, :2], generator[3, 2] = after, 1.0
    generator -= np.diag(generator.sum(axis=1))
    for number in range(1, 121):
        now = bank.advance(now, WAVE, 1.0 / 60.0)
        expected = np.array([0.5, 0.5, 0.0, 0.0]) @ expm(number / 60.0 * generator)
        still = expected[:2].sum()
        assert now.weights[STILL].sum() == pytest.approx(still, abs=0.01)
        assert now.resting == pytest.approx(expected[1] / still, abs=0.01)


def test_target_that_starts_may_have_any_usual_velocity():
    states = np.zeros((MODELS, 3, SIZE))
    covariances = np.tile(1e-12 * np.eye(SIZE), (MODELS, 3, 1, 1))
    weights = np.eye(MODELS)[STILL.start + 1]
    lively = dataclasses.replace(
        ASSUMED, pause_dwell=1.0, rest_dwell=1.0, steady_dwell=1.0, turn_dwell=1.0
    )
    ahead = Bank(lively).advance(bank_of(states, covariances, weights), WAVE, 0.1)
    deviation = np.sqrt(covariances_of(ahead)[MOVING, :, 1, 1])
    np.testing.assert_allclose(deviation, ASSUMED.start_speed, rtol=0.25)


def test_update_of_full_certainty_is_the_kalman_filters():
    random = np.random.default_rng(2)
    states = random.normal(size=(MODELS, 3, SIZE))
    roots = random.normal(size=(MODELS, 3, SIZE, SIZE))
    covariances = roots @ roots.swapaxes(-1, -2)
    bank = bank_of(states, covariances, WEIGHTS)
    position, variance = random.normal(size=3), np.array([0.1, 0.2, 0.3])
    after = update(bank, innovations(bank, position, variance), 1.0)
    likelihood = np.ones(MODELS)
    row = np.array([[1.0, 0.0, 0.0, 0.0, 1.0]])
    for model in range(MODELS):
        for axis in range(3):
            before = covariances[model, axis]
            spread = row @ before @ row.T + variance[axis]
            gain = before @ row.T / spread
            miss = position[axis] - row @ states[model, axis]
            np.testing.assert_allclose(
                states_of(after)[model, axis],
                states[model, axis] + gain[:, 0] * miss,
                atol=1e-12,
            )
            np.testing.assert_allclose(
                covariances_of(after)[model, axis], before - gain @ row @ before, atol=1e-12
            )
            likelihood[model] *= float(
                np.exp(-0.5 * miss**2 / spread[0, 0])[0] / np.sqrt(spread[0, 0])
            )
    expected = bank.weights * likelihood
    np.testing.assert_allclose(after.weights, expected / expected.sum(), atol=1e-9)


def test_moments_are_those_of_the_mixture():
    random = np.random.default_rng(6)
    states = random.normal(size=(MODELS, 3, SIZE))
    roots = random.normal(size=(MODELS, 3, SIZE, SIZE))
    covariances = roots @ roots.swapaxes(-1, -2)
    mean, spread = moments(bank_of(states, covariances, WEIGHTS))
    # Still targets settle quicker than their hypotheses say.
    covariances[STILL] *= 0.3
    model = random.choice(MODELS, 200_000, p=WEIGHTS)
    root = np.linalg.cholesky(covariances)
    drawn = states[model] + np.einsum(
        'naij,naj->nai', root[model], random.standard_normal((model.size, 3, SIZE))
    )
    # Positions along the axes, then velocities.
    drawn = drawn[..., :2].swapaxes(1, 2).reshape(-1, 6)
    np.testing.assert_allclose(mean, drawn.mean(axis=0), atol=0.03)
    np.testing.assert_allclose(spread, np.cov(drawn.T), rtol=0.03, atol=0.06)
