"""The bank's arithmetic against matrix exponentials, and the wave model against its theory."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov

from binopos_ros.smoothing.bank import (
    CALM,
    MODELS,
    MOVING,
    SIZE,
    STEADY,
    STILL,
    TURNING,
    Bank,
    Hypotheses,
    Motion,
    innovations,
    moments,
    update,
)
from binopos_ros.smoothing.wave import oscillator

MOTION = Motion(
    still_density=1e-9,
    steady_density=1e-4,
    turn_acceleration=0.3,
    turn_time=50.0,
    first_speed=0.2,
    start_speed=0.05,
    dwells=(1e12, 1e12, 1e12),
    wave_frequencies=(2.0, 3.0),
    wave_dwell=1e12,
    calm_dwell=1e12,
    wave_damping=0.25,
)
WEIGHTS = np.array([0.05, 0.1, 0.1, 0.1, 0.2, 0.1, 0.1, 0.05, 0.2])
WAVE = np.array([1e-6, 2e-6, 4e-5])
OMEGAS = 2.0 * np.pi * np.array(MOTION.wave_frequencies)
STEADY_QUICK, TURNING_SLOW = STEADY.start + 2, TURNING.start + 1


def continuous(model):
    """Return drift and noise density (5, 5) of a moving hypothesis, waves of unit variance."""
    drift, density = np.zeros((5, 5)), np.zeros((5, 5))
    drift[0, 1] = 1.0
    if model == STEADY_QUICK:
        density[1, 1] = MOTION.steady_density
    else:
        drift[1, 2] = 1.0
        drift[2, 2] = -1.0 / MOTION.turn_time
        density[2, 2] = 2.0 * MOTION.turn_acceleration**2 / MOTION.turn_time
    omega = OMEGAS[1 if model == STEADY_QUICK else 0]
    drift[3, 4] = omega
    drift[4, 3] = -omega
    drift[4, 4] = -2.0 * MOTION.wave_damping * omega
    density[4, 4] = 4.0 * MOTION.wave_damping * omega
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


@pytest.mark.parametrize('model', [STEADY_QUICK, TURNING_SLOW])
@pytest.mark.parametrize('time', [1e-2, 1 / 30, 0.2])
def test_prediction_of_a_hypothesis_is_the_exact_discretisation(model, time):
    random = np.random.default_rng(model)
    states = np.zeros((MODELS, 3, SIZE))
    states[model] = random.normal(size=(3, SIZE))
    root = random.normal(size=(SIZE, SIZE)) * 0.01
    if model == STEADY_QUICK:
        states[model, :, 2] = 0.0
        root[2] = 0.0
    covariances = np.tile(root @ root.T, (MODELS, 3, 1, 1))
    start = Hypotheses(states, covariances, np.full(MODELS, 1.0 / MODELS))
    ahead = Bank(MOTION).advance(start, WAVE, time)
    drift, density = continuous(model)
    for axis in range(3):
        scale = np.ones(5)
        scale[3:] = np.sqrt(WAVE[axis])
        psi, noise = van_loan(drift, density * np.outer(scale, scale), time)
        np.testing.assert_allclose(
            ahead.states[model, axis], psi @ states[model, axis], rtol=1e-4, atol=1e-9
        )
        expected = psi @ covariances[model, axis] @ psi.T + noise
        np.testing.assert_allclose(ahead.covariances[model, axis], expected, rtol=2e-2, atol=1e-9)


def test_still_target_forgets_velocity_and_acceleration():
    states = np.ones((MODELS, 3, SIZE))
    covariances = np.tile(np.eye(SIZE), (MODELS, 3, 1, 1))
    start = Hypotheses(states, covariances, np.repeat([1.0, 0.0, 0.0], 3) / 3.0)
    ahead = Bank(MOTION).advance(start, WAVE, 0.1)
    assert np.all(ahead.states[STILL, :, 1:3] == 0.0)
    np.testing.assert_array_equal(ahead.states[STILL, :, 0], 1.0)


def test_switching_is_a_markov_chain_in_continuous_time():
    lively = dataclasses.replace(MOTION, dwells=(1.0, 2.0, 0.5), wave_dwell=3.0, calm_dwell=5.0)
    states = np.zeros((MODELS, 3, SIZE))
    covariances = np.tile(1e-12 * np.eye(SIZE), (MODELS, 3, 1, 1))
    weights = np.array([0.1, 0.3, 0.05, 0.1, 0.05, 0.1, 0.1, 0.1, 0.1])
    start, bank = Hypotheses(states, covariances, weights), Bank(lively)
    rates = np.repeat(1.0 / np.array(lively.dwells), 3)
    # From calm, slow, quick to calm, slow, quick.
    water = np.array([[0.0, 0.1, 0.1], [0.2, 0.0, 1.0 / 3.0], [0.2, 1.0 / 3.0, 0.0]])
    generator = np.zeros((MODELS, MODELS))
    for one in range(MODELS):
        for other in range(MODELS):
            if one % 3 == other % 3 and one != other:
                generator[one, other] = rates[one] / 2.0
            elif one // 3 == other // 3:
                generator[one, other] = water[one % 3, other % 3]
        generator[one, one] = -generator[one].sum()
    ahead = bank.advance(start, WAVE, 0.7)
    np.testing.assert_allclose(ahead.weights, weights @ expm(0.7 * generator), atol=1e-12)
    twice = bank.advance(bank.advance(start, WAVE, 0.3), WAVE, 0.4)
    np.testing.assert_allclose(twice.weights, ahead.weights, atol=1e-12)


def test_calm_water_forgets_the_waves_and_holds_their_spread_ready():
    random = np.random.default_rng(4)
    roots = random.normal(size=(MODELS, 3, SIZE, SIZE))
    covariances = roots @ roots.swapaxes(-1, -2)
    start = Hypotheses(random.normal(size=(MODELS, 3, SIZE)), covariances, WEIGHTS)
    ahead = Bank(MOTION).advance(start, WAVE, 1.0 / 30.0)
    np.testing.assert_array_equal(ahead.states[CALM, :, 3:], 0.0)
    np.testing.assert_array_equal(ahead.covariances[CALM, :, :3, 3:], 0.0)
    spread = WAVE[:, None, None] * np.eye(2)
    expected = np.broadcast_to(spread, (3, 3, 2, 2))
    np.testing.assert_allclose(ahead.covariances[CALM, :, 3:, 3:], expected, rtol=1e-12)


def test_target_that_starts_may_have_any_usual_velocity():
    states = np.zeros((MODELS, 3, SIZE))
    covariances = np.tile(1e-12 * np.eye(SIZE), (MODELS, 3, 1, 1))
    weights = np.eye(MODELS)[STILL.start + 1]
    lively = dataclasses.replace(MOTION, dwells=(1.0, 1.0, 1.0))
    ahead = Bank(lively).advance(Hypotheses(states, covariances, weights), WAVE, 0.1)
    deviation = np.sqrt(ahead.covariances[MOVING, :, 1, 1])
    np.testing.assert_allclose(deviation, MOTION.start_speed, rtol=0.25)


def test_update_of_full_certainty_is_the_kalman_filters():
    random = np.random.default_rng(2)
    states = random.normal(size=(MODELS, 3, SIZE))
    roots = random.normal(size=(MODELS, 3, SIZE, SIZE))
    covariances = roots @ roots.swapaxes(-1, -2)
    # In calm water the oscillator has no mean and no part in the rest.
    states[CALM, :, 3:] = covariances[CALM, :, 3:, :3] = covariances[CALM, :, :3, 3:] = 0.0
    bank = Hypotheses(states, covariances, WEIGHTS)
    position, variance = random.normal(size=3), np.array([0.1, 0.2, 0.3])
    after = update(bank, *innovations(bank, position, variance), np.ones(1))
    likelihood = np.ones(MODELS)
    for model in range(MODELS):
        row = np.array([[1.0, 0.0, 0.0, 0.0, 0.0 if model % 3 == 0 else 1.0]])
        for axis in range(3):
            before = covariances[model, axis]
            own = variance[axis] * (3.0 if model % 3 == 0 else 1.0)
            spread = row @ before @ row.T + own
            gain = before @ row.T / spread
            miss = position[axis] - row @ states[model, axis]
            np.testing.assert_allclose(
                after.states[model, axis], states[model, axis] + gain[:, 0] * miss, atol=1e-12
            )
            np.testing.assert_allclose(
                after.covariances[model, axis], before - gain @ row @ before, atol=1e-12
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
    weights = WEIGHTS
    mean, spread = moments(Hypotheses(states, covariances, weights))
    model = random.choice(MODELS, 200_000, p=weights)
    root = np.linalg.cholesky(covariances[:, 1])
    drawn = states[model, 1] + np.einsum(
        'nij,nj->ni', root[model], random.standard_normal((model.size, SIZE))
    )
    np.testing.assert_allclose(mean[1], drawn[:, :2].mean(axis=0), atol=0.03)
    np.testing.assert_allclose(spread[1], np.cov(drawn[:, :2].T), rtol=0.03, atol=0.03)
