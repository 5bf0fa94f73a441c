"""The default smoother's own behaviour, beside what the protocols show."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.smoothing import make_filter

COVARIANCE = np.diag([1e-8, 1e-8, 1e-6])
PLACE = np.array([0.1, -0.05, 1.2])


#: Of waves whose size the rays' miss tells: of those below, of a usual size.
WAVING = np.diag([0.001, 0.001, 0.01]) ** 2


def track(positions, covariance=COVARIANCE, rate=30.0, medium=None):
    smoother = make_filter('cloud-kalman')
    whole = covariance if medium is None else covariance + medium
    return [
        smoother.step(number / rate, position, whole, medium)
        for number, position in enumerate(positions)
    ]


def waves(count, frequency, size, rate=30.0):
    stamps = np.arange(count) / rate
    phases = np.array([0.0, 1.0, 2.0])
    return size * np.sin(2 * np.pi * frequency * stamps[:, None] + phases)


@pytest.mark.parametrize('frequency', [1.0, 1.2, 1.4, 1.6, 2.5, 4.0, 6.0])
def test_waves_of_any_basin_leave_a_still_target_in_its_place(frequency):
    swing = waves(300, frequency, [0.002, 0.002, 0.015])
    states = track(PLACE + swing, medium=WAVING)
    errors = np.array([state.position for state in states])[60:] - PLACE
    assert np.sqrt(np.mean(errors**2)) < 0.1 * np.sqrt(np.mean(swing**2))


def test_target_that_is_shaken_in_calm_water_is_not_taken_for_swell():
    stamps = np.arange(300) / 30.0
    angle = 2.0 * np.pi * 1.2 * stamps
    swing = 0.013 * np.column_stack([np.sin(angle), np.cos(angle), 0.5 * np.sin(angle)])
    noise = np.random.default_rng(3).normal(0.0, [1e-4, 1e-4, 1e-3], (300, 3))
    found = np.array([state.position for state in track(PLACE + swing + noise)])
    errors = (found - PLACE - swing)[30:]
    assert np.sqrt(np.mean(errors**2)) < 0.2 * np.sqrt(np.mean(swing**2))


def test_target_that_rests_is_surer_than_one_that_has_just_stopped():
    stamps = np.arange(450) / 30.0
    way = 0.1 * np.clip(stamps, 0.0, 2.0)
    line = PLACE + np.column_stack([way, 0.0 * way, 0.0 * way])
    states = track(line + waves(450, 3.0, [0.001, 0.001, 0.006]), medium=WAVING)
    spreads = [np.sqrt(np.trace(state.covariance[:3, :3])) for state in states]
    assert np.mean(spreads[420:]) < 0.5 * np.mean(spreads[75:105])


@pytest.mark.parametrize('rate', [10, 60, 120])
def test_frame_rate_does_not_matter(rate):
    stamps = np.arange(8 * rate) / rate
    swing = waves(stamps.size, 2.5, [0.002, 0.002, 0.015], rate)
    line = PLACE + np.outer(stamps, [0.08, 0.03, 0.01])
    for path, share in ((PLACE, 0.05), (line, 0.15)):
        found = np.array(
            [state.position for state in track(path + swing, rate=rate, medium=WAVING)]
        )
        error = (found - path)[2 * rate :]
        assert np.sqrt(np.mean(error**2)) < share * np.sqrt(np.mean(swing**2))


def test_covariance_follows_the_medium_from_calm_to_rough_and_back():
    swing = waves(900, 2.5, [0.001, 0.001, 0.008])
    medium = np.full(900, 1.0)
    swing[300:600] *= 5.0
    medium[300:600] = 25.0
    smoother = make_filter('cloud-kalman')
    spreads = [
        smoother.step(k / 30.0, PLACE + swing[k], COVARIANCE + m * WAVING, m * WAVING).covariance
        for k, m in enumerate(medium)
    ]
    depths = [np.sqrt(spread[2, 2]) for spread in spreads]
    assert depths[599] > 1.5 * depths[299]
    assert depths[899] < depths[599]


def test_velocity_of_a_steady_target_is_found():
    velocity = np.array([0.1, -0.05, 0.02])
    line = PLACE + np.outer(np.arange(150) / 30.0, velocity)
    state = track(line + waves(150, 3.0, [0.001, 0.001, 0.006]), medium=WAVING)[-1]
    np.testing.assert_allclose(state.velocity, velocity, atol=0.01)


def test_start_and_stop_of_a_target_are_followed_within_half_a_second():
    stamps = np.arange(240) / 30.0
    way = 0.15 * np.clip(stamps - 3.0, 0.0, 2.0)
    line = PLACE + np.column_stack([way, 0.0 * way, 0.0 * way])
    states = track(line + waves(240, 3.0, [0.001, 0.001, 0.006]), medium=WAVING)
    assert abs(states[105].position[0] - line[105, 0]) < 0.01
    assert abs(states[165].position[0] - line[165, 0]) < 0.01
    assert abs(states[239].position[0] - line[239, 0]) < 0.002


def test_one_wrong_detection_has_no_certainty_and_a_row_of_them_is_believed():
    positions = np.tile(PLACE, (120, 1))
    positions += np.random.default_rng(3).normal(0.0, [2e-4, 2e-4, 2e-3], (120, 3))
    positions[60] += [0.3, 0.0, 0.0]
    positions[90:] += [0.3, 0.0, 0.0]
    states = track(positions)
    assert states[60].certainty == 0.0
    assert 'certainty' in states[60].reason
    assert abs(states[61].position[0] - PLACE[0]) < 0.002
    assert abs(states[119].position[0] - PLACE[0] - 0.3) < 0.005


def test_good_measurements_weigh_fully_on_average():
    swing = waves(300, 3.0, [0.001, 0.001, 0.006])
    certainties = [state.certainty for state in track(PLACE + swing, medium=WAVING)][60:]
    assert np.mean(certainties) > 0.7


def test_line_of_sight_off_the_axis_makes_no_difference():
    # The same scene, turned by 25 degrees about y, gives the same track turned.
    angle = np.radians(25.0)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    noise = np.random.default_rng(7).normal(0.0, [1e-4, 1e-4, 1e-3], (150, 3))
    positions = PLACE + waves(150, 3.0, [0.001, 0.001, 0.008]) + noise
    straight = track(positions, medium=WAVING)[-1]
    turned = track(positions @ turn.T, turn @ COVARIANCE @ turn.T, medium=turn @ WAVING @ turn.T)[
        -1
    ]
    np.testing.assert_allclose(turned.position, turn @ straight.position, atol=2e-4)
    assert turned.covariance[0, 2] > 0.0


def test_covariances_of_any_proportion_are_taken():
    for covariance in (np.eye(3) * 1e-6, np.diag([1e-4, 1e-8, 1e-8]), np.eye(3) * 1e-15):
        states = track(PLACE + waves(90, 3.0, 0.002), covariance)
        assert np.linalg.norm(states[-1].position - PLACE) < 0.003
