"""The ladder of manoeuvring indices: a Kalman filter on each rung, and no unit anywhere."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter as PeerFilter

from binopos_ros.smoothing import ladder, make_filter, rungs

PLACE = np.array([0.1, -0.05, 1.2])
COVARIANCE = np.array([[2e-8, 0, 3e-9], [0, 1e-8, 0], [3e-9, 0, 1e-6]])


def hovering(rate, count=150, seed=4):
    """Return stamps, truth and measured positions as a rig sees them that hovers."""
    random = np.random.default_rng(seed)
    stamps = 5.0 + np.arange(count) / rate
    truth = PLACE + 0.05 * np.sin(2.0 * np.pi * np.outer(stamps, [0.3, 0.2, 0.45]))
    noise = random.standard_normal((count, 3)) @ np.linalg.cholesky(COVARIANCE).T
    return stamps, truth, truth + noise


def run(stamps, positions, covariance):
    smoother = make_filter('cloud-kalman')
    return [smoother.step(*each, covariance) for each in zip(stamps, positions, strict=True)]


@pytest.mark.parametrize(('length', 'time'), [(10.0, 1.0), (1e-3, 1.0), (1.0, 0.5), (7.0, 3.0)])
def test_the_same_motion_at_another_scale_is_filtered_alike(length, time):
    stamps, _, positions = hovering(30.0)
    plain = run(stamps, positions, COVARIANCE)
    scaled = run(time * stamps, length * positions, length**2 * COVARIANCE)
    for one, other in zip(plain, scaled, strict=True):
        np.testing.assert_allclose(other.position, length * one.position, rtol=1e-6)
        speed = length / time
        np.testing.assert_allclose(
            other.velocity, speed * one.velocity, rtol=1e-6, atol=1e-6 * speed
        )
        np.testing.assert_allclose(
            other.covariance[:3, :3],
            length**2 * one.covariance[:3, :3],
            rtol=1e-6,
            atol=1e-12 * length**2,
        )


def test_a_rung_by_itself_is_the_kalman_filter_of_its_index():
    # Without switches and with one rung's weight alone, what is left is a plain Kalman filter.
    rung, variance, elapsed = 5, np.array([4e-8, 1e-8, 1e-6]), 1.0 / 30.0
    index = rungs.INDICES[rung]
    assert 0.0 < index < 1.0
    now = ladder.start(PLACE, variance)
    weights = np.full_like(now.moments[ladder.WEIGHT], 1e-200)
    weights[:, rung] = 1.0

    def alone(bank):
        """Return the bank with that rung's weight alone."""
        return bank._replace(moments=bank.moments / bank.moments[ladder.WEIGHT] * weights)

    chain, random = rungs.switching(20.0), np.random.default_rng(1)
    peer = PeerFilter(dim_x=2, dim_z=1)
    peer.H = np.array([[1.0, 0.0]])
    peer.R = np.array([[variance[0]]])
    peer.F = np.array([[1.0, elapsed], [0.0, 1.0]])
    density = index * variance[0] / elapsed**3
    peer.Q = density * np.array([[elapsed**3 / 3, elapsed**2 / 2], [elapsed**2 / 2, elapsed]])
    speed = max(100.0 * index, 1.0) * variance[0] / elapsed**2
    peer.x, peer.P = np.array([[PLACE[0]], [0.0]]), np.diag([variance[0], speed])
    for _ in range(20):
        now = ladder.advance(alone(now), chain, elapsed)
        position = PLACE + random.normal(0.0, 3e-4, 3)
        # Far from the switches' prior, the rung keeps its own state but for a part in 20.
        peer.predict()
        peer.update(position[0])
        now = ladder.correct(now, position, variance, 0.02, 50.0)
        now = alone(now)
    mean, covariance = ladder.moments(now)
    np.testing.assert_allclose(mean[0, 0], peer.x[0, 0], atol=3e-5)
    np.testing.assert_allclose(covariance[0, 0], peer.P[0, 0], rtol=0.2)


def test_a_ladder_begins_with_what_another_filter_says():
    random = np.random.default_rng(2)
    root = random.normal(size=(6, 6))
    mean, covariance = np.concatenate([PLACE, [0.1, 0.0, -0.2]]), root @ root.T
    begun = ladder.begun(ladder.start(PLACE + 1.0, np.ones(3)), mean, covariance)
    np.testing.assert_allclose(ladder.mean_position(begun), PLACE, atol=1e-12)
    shares = begun.moments[ladder.WEIGHT]
    for moment, expected in (
        (ladder.V, mean[3:]),
        (ladder.PP, np.diagonal(covariance)[:3]),
        (ladder.PV, np.diagonal(covariance, 3)),
        (ladder.VV, np.diagonal(covariance)[3:] + mean[3:] ** 2),
    ):
        found = (begun.moments[moment] / shares)[:, rungs.STEADY :]
        np.testing.assert_allclose(found, np.tile(expected, (found.shape[1], 1)).T, atol=1e-12)
    # What has no velocity begins without one.
    assert np.all(begun.moments[ladder.V, :, rungs.STANDING] == 0.0)


def test_velocity_is_unbiased_on_a_circle():
    random = np.random.default_rng(3)
    stamps = np.arange(600) / 30.0
    angle = 2.0 * np.pi * stamps
    circle = 0.1 * np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    velocity = 2.0 * np.pi * 0.1 * np.column_stack([-np.sin(angle), np.cos(angle), 0.0 * angle])
    deviation = np.array([1e-4, 1e-4, 1e-3])
    positions = PLACE + circle + random.normal(0.0, deviation, circle.shape)
    states = run(stamps, positions, np.diag(deviation**2))[30:]
    error = np.array([state.velocity for state in states]) - velocity[30:]
    spread = np.array([np.diagonal(state.covariance)[3:] for state in states])
    assert np.all(
        np.abs(error.mean(axis=0)) < 4.0 * np.sqrt(spread.mean(axis=0) / len(error)) + 2e-3
    )


def test_gaps_and_jittering_stamps_are_taken_as_they_are():
    random = np.random.default_rng(8)
    stamps, truth, positions = hovering(60.0, 400)
    stamps = stamps + random.normal(0.0, 1e-3, stamps.size)
    kept = random.random(stamps.size) < 0.3
    kept[0] = True
    states = run(stamps[kept], positions[kept], COVARIANCE)
    error = np.array([state.position for state in states]) - truth[kept]
    raw = (positions - truth)[kept]
    assert np.sqrt(np.mean(error[10:] ** 2)) < np.sqrt(np.mean(raw[10:] ** 2))


def test_a_target_that_is_known_to_be_fixed_is_averaged():
    # Nothing does better than the mean, whose error is honest as well.
    count, deviation = 300, np.array([4e-4, 4e-4, 3e-3])
    errors, means, squares = [], [], []
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0.0, deviation, (count, 3))
        smoother = make_filter('cloud-kalman', resting_frames=1e4)
        states = [
            smoother.step(number / 30.0, PLACE + each, np.diag(deviation**2))
            for number, each in enumerate(noise)
        ]
        error = np.array([state.position for state in states[30:]]) - PLACE
        variance = np.array([np.diagonal(state.covariance)[:3] for state in states[30:]])
        errors.append(error)
        squares.append(np.mean(error**2 / variance))
        means.append((np.cumsum(noise, axis=0) / np.arange(1, count + 1)[:, None])[30:])
    assert np.sqrt(np.mean(np.square(errors))) < 1.1 * np.sqrt(np.mean(np.square(means)))
    assert 0.5 < np.mean(squares) < 1.5
