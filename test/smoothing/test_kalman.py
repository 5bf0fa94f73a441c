"""The plain Kalman filter against filterpy, and the opponents against what their sources say."""

from __future__ import annotations

import filterpy.kalman
import numpy as np
import pytest

from binopos_ros.smoothing import make_filter

PLAIN = {'measurement_scale': 2.0, 'measurement_std': 0.003, 'initial_speed': 0.2}


@pytest.fixture(scope='module')
def measurements():
    """Irregular stamps, positions of a moving target, covariances that are not diagonal."""
    random = np.random.default_rng(11)
    stamps = np.cumsum(random.uniform(0.01, 0.2, 150))
    truth = np.array([0.1, 0.2, 1.2]) + np.outer(stamps, [0.05, -0.03, 0.01])
    roots = random.normal(size=(150, 3, 3)) * 2e-3 + 3e-3 * np.eye(3)
    noise = np.einsum('nij,nj->ni', roots, random.standard_normal((150, 3)))
    return stamps, truth + noise, roots @ roots.swapaxes(1, 2)


def oracle(density):
    """Return filterpy's filter at the state of ours before the first measurement's successor."""
    kalman = filterpy.kalman.KalmanFilter(dim_x=6, dim_z=3)
    kalman.H = np.hstack([np.eye(3), np.zeros((3, 3))])
    kalman.density = density
    return kalman


def oracle_step(kalman, elapsed, position, noise):
    psi = np.eye(6)
    psi[:3, 3:] = elapsed * np.eye(3)
    process = kalman.density * np.kron(
        [[elapsed**3 / 3, elapsed**2 / 2], [elapsed**2 / 2, elapsed]], np.eye(3)
    )
    kalman.predict(F=psi, Q=process)
    kalman.update(position, R=noise)


def test_kalman_is_filterpys_to_rounding(measurements):
    stamps, positions, covariances = measurements
    ours = make_filter('kalman', acceleration_density=0.01, **PLAIN)
    noises = 2.0 * covariances + 0.003**2 * np.eye(3)
    theirs = oracle(0.01)
    theirs.x = np.concatenate([positions[0], np.zeros(3)])
    theirs.P = np.zeros((6, 6))
    theirs.P[:3, :3] = noises[0]
    theirs.P[3:, 3:] = 0.2**2 * np.eye(3)
    ours.step(stamps[0], positions[0], covariances[0])
    for number in range(1, len(stamps)):
        state = ours.step(stamps[number], positions[number], covariances[number])
        elapsed = stamps[number] - stamps[number - 1]
        oracle_step(theirs, elapsed, positions[number], noises[number])
        np.testing.assert_allclose(state.position, theirs.x[:3], rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.velocity, theirs.x[3:], rtol=0, atol=1e-9)
        np.testing.assert_allclose(state.covariance, theirs.P, rtol=0, atol=1e-9)


def test_prediction_is_filterpys(measurements):
    stamps, positions, covariances = measurements
    ours = make_filter('kalman', acceleration_density=0.01, **PLAIN)
    for step in zip(stamps, positions, covariances, strict=True):
        state = ours.step(*step)
    theirs = oracle(0.01)
    theirs.x, theirs.P = np.concatenate([state.position, state.velocity]), state.covariance
    psi = np.eye(6)
    psi[:3, 3:] = 1.5 * np.eye(3)
    theirs.predict(
        F=psi, Q=0.01 * np.kron([[1.5**3 / 3, 1.5**2 / 2], [1.5**2 / 2, 1.5]], np.eye(3))
    )
    ahead = ours.predict(stamps[-1] + 1.5)
    np.testing.assert_allclose(ahead.position, theirs.x[:3], atol=1e-9)
    np.testing.assert_allclose(ahead.covariance, theirs.P, atol=1e-9)


def states(name, measurements, **options):
    smoother = make_filter(name, **options)
    return [smoother.step(*step) for step in zip(*measurements, strict=True)]


@pytest.mark.parametrize(
    ('name', 'options'),
    [
        ('huber', {'threshold': 100.0}),
        ('student-t', {'freedom': 1e4}),
        ('imm', {'low_density': 0.01, 'middle_density': 0.01, 'high_density': 0.01}),
    ],
)
def test_opponent_without_its_speciality_is_the_kalman_filter(name, options, measurements):
    density = {} if name == 'imm' else {'acceleration_density': 0.01}
    special = states(name, measurements, **PLAIN, **density, **options)
    plain = states('kalman', measurements, acceleration_density=0.01, **PLAIN)
    for one, other in zip(special, plain, strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=2e-5)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=0.02, atol=1e-6)


def test_random_walk_is_filterpys(measurements):
    stamps, positions, covariances = measurements
    kalman = filterpy.kalman.KalmanFilter(dim_x=3, dim_z=3)
    kalman.H = np.eye(3)
    kalman.x, kalman.P = positions[0].copy(), covariances[0].copy()
    options = {'measurement_scale': 1.0, 'measurement_std': 0.0, 'walk_density': 1e-3}
    ours = states('kalman-random-walk', measurements, **options)
    for number in range(1, len(stamps)):
        elapsed = stamps[number] - stamps[number - 1]
        kalman.predict(F=np.eye(3), Q=1e-3 * elapsed * np.eye(3))
        kalman.update(positions[number], R=covariances[number])
        np.testing.assert_allclose(ours[number].position, kalman.x, atol=1e-9)


def test_moving_median_is_the_median_of_the_last_positions(measurements):
    _, positions, _ = measurements
    ours = states('median', measurements, window=5)
    for number, state in enumerate(ours):
        expected = np.median(positions[max(0, number - 4) : number + 1], axis=0)
        np.testing.assert_allclose(state.position, expected, atol=1e-15)


@pytest.mark.parametrize('name', ['sage-husa', 'variational-bayes'])
def test_adaptive_filter_finds_the_noise_that_it_was_not_told(name):
    random = np.random.default_rng(0)
    true = np.array([0.004, 0.008, 0.03])
    options = {'measurement_std': 0.02, 'acceleration_density': 1e-8, 'initial_speed': 1e-4}
    memory_options = (
        {'forgetting': 0.995, 'divergence': 100.0} if name == 'sage-husa' else {'spreading': 0.995}
    )
    smoother = make_filter(name, **options, **memory_options)
    for number in range(1500):
        position = np.array([0.0, 0.0, 1.2]) + true * random.standard_normal(3)
        smoother.step(number / 30.0, position, 1e-8 * np.eye(3))
    memory = smoother._memory
    found = (
        np.sqrt(np.diagonal(memory.noise))
        if name == 'sage-husa'
        else np.sqrt(memory.scale / memory.shape)
    )
    np.testing.assert_allclose(found, true, rtol=0.15)


@pytest.mark.parametrize('name', ['huber', 'cloud-kalman'])
def test_robust_filter_shrugs_off_a_wrong_detection(name):
    shifts = []
    for wrong in (0.0, 0.3):
        random = np.random.default_rng(5)
        smoother = make_filter(name)
        for number in range(90):
            position = np.array([0.1, 0.0, 1.2]) + random.normal(0.0, [5e-4, 5e-4, 4e-3])
            position[0] += wrong if number == 80 else 0.0
            state = smoother.step(number / 30.0, position, np.diag([1e-8, 1e-8, 1e-6]))
            if number == 80:
                shifts.append(state.position[0])
    assert abs(shifts[1] - shifts[0]) < 0.02 * 0.3


def test_student_t_filter_doubts_itself_after_an_outlier():
    smoother = make_filter('student-t', freedom=4.0)
    place, covariance = np.array([0.1, 0.0, 1.2]), np.diag([1e-8, 1e-8, 1e-6])
    for number in range(60):
        before = smoother.step(number / 30.0, place, covariance)
    after = smoother.step(2.0, place + 0.4, covariance)
    assert np.trace(after.covariance[:3, :3]) > 2.0 * np.trace(before.covariance[:3, :3])
    assert after.certainty < 0.5


def test_coloured_noise_filter_beats_the_plain_one_on_the_noise_it_knows():
    random = np.random.default_rng(9)
    place = np.array([0.0, 0.0, 1.0])
    stamps = np.arange(400) / 30.0
    swing = 0.01 * np.sin(2 * np.pi * 2.5 * stamps[:, None] + random.uniform(0, 6.28, 3))
    options = {'measurement_scale': 1.0, 'measurement_std': 0.007, 'acceleration_density': 0.01}
    errors = {}
    for name, extra in (('kalman', {}), ('coloured-noise', {'frequency': 2.5, 'damping': 0.05})):
        smoother = make_filter(name, **options, **extra)
        track = [
            smoother.step(stamp, shift + place, 1e-8 * np.eye(3)).position - place
            for stamp, shift in zip(stamps, swing, strict=True)
        ]
        errors[name] = np.sqrt(np.mean(np.square(track[60:])))
    assert errors['coloured-noise'] < 0.5 * errors['kalman']
