"""Positions in the fixed frame and their covariances, against samples of the errors themselves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from binopos_ros.platform import (
    FixedFrameOptions,
    Missing,
    Platform,
    PlatformError,
    PlatformOptions,
    WaitingRoom,
)

SECOND = 10**9
PERIOD = 20_000_000
FORWARD = Rotation.from_matrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
MOUNTING = (0.2, 0.06, -0.05, *FORWARD.as_quat().tolist())
AT_REST = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def platform_with(**values):
    options = PlatformOptions(**{'source': 'odometry', 'mounting': MOUNTING, **values})
    return Platform(FixedFrameOptions('odom', options))


def feed(platform, stamp, place=AT_REST, covariance=None):
    covariance = np.zeros((6, 6)) if covariance is None else covariance
    return platform.odometry.add(stamp, 'odom', 'base_link', *place, covariance)


def fixed(platform, stamp, point, covariance, **parts):
    pose = platform.rig_pose(stamp, 'left')
    assert not isinstance(pose, Missing), pose
    return pose.carry(np.asarray(point, float), covariance, **parts)


def test_the_covariance_is_that_of_sampled_errors_of_robot_and_position():
    rng = np.random.default_rng(1)
    spread = rng.normal(size=(6, 6)) * [[0.003], [0.002], [0.004], [0.001], [0.002], [0.003]]
    robot = spread @ spread.T
    own = np.diag([1e-6, 1e-6, 9e-6])
    place = np.array([1.0, -2.0, 0.5])
    turn = Rotation.from_rotvec([0.3, -0.4, 1.1])
    point = np.array([0.1, -0.2, 2.5])
    platform = platform_with()
    feed(platform, 0, (place.tolist(), turn.as_quat().tolist()), robot)
    result = fixed(platform, 0, point, own)
    offset = np.array(MOUNTING[:3])

    def carried(point, error):
        turned = Rotation.from_rotvec(error[:, 3:]) * turn
        return place + error[:, :3] + turned.apply(offset + FORWARD.apply(point))

    np.testing.assert_allclose(result.point, carried(point, np.zeros((1, 6)))[0], atol=1e-12)
    count = 200_000
    errors = rng.multivariate_normal(np.zeros(6), robot, count)
    noisy = carried(point + rng.multivariate_normal(np.zeros(3), own, count), errors)
    np.testing.assert_allclose(result.covariance, np.cov(noisy.T), rtol=0.03, atol=2e-8)
    assert result.systematic is None


def test_parts_of_the_covariance_turn_with_the_rig():
    turn = Rotation.from_rotvec([0.3, -0.4, 1.1])
    platform = platform_with(mounting=(0, 0, 0, 0, 0, 0, 1))
    feed(platform, 0, ((0, 0, 0), turn.as_quat().tolist()))
    part = np.diag([1e-6, 2e-6, 3e-6])
    result = fixed(platform, 0, (0, 0, 1), 2 * part, systematic=part, medium=0.5 * part)
    expected = turn.as_matrix() @ part @ turn.as_matrix().T
    np.testing.assert_allclose(result.covariance, 2 * expected, atol=1e-15)
    np.testing.assert_allclose(result.systematic, expected, atol=1e-15)
    np.testing.assert_allclose(result.medium, 0.5 * expected, atol=1e-15)


def test_an_uncertain_clock_weighs_as_much_as_the_target_moves_in_it():
    rate, speed, stamp_std = 0.2, 0.1, 0.005
    platform = platform_with(stamp_std=stamp_std, mounting=(0, 0, 0, 0, 0, 0, 1))
    for k in range(2):
        turn = Rotation.from_rotvec([0, 0, rate * k * PERIOD / SECOND]).as_quat().tolist()
        feed(platform, k * PERIOD, ((speed * k * PERIOD / SECOND, 0, 0), turn))
    still = fixed(platform, 0, (2.0, 0, 0), np.eye(3) * 1e-6)
    # Rate times range across, speed along.
    motion = stamp_std * np.array([speed, 2.0 * rate, 0.0])
    np.testing.assert_allclose(still.systematic, np.outer(motion, motion), atol=1e-12)
    noise = still.covariance - still.systematic
    np.testing.assert_allclose(noise - np.eye(3) * 1e-6, np.outer(motion, motion), atol=1e-12)


def test_given_deviations_take_the_place_of_the_odometry_s():
    platform = platform_with(position_std=0.01, rotation_std=0.002)
    feed(platform, 0, covariance=np.eye(6))
    result = fixed(platform, 0, (0, 0, 3.0), np.zeros((3, 3)))
    lever = 3.2
    across = 0.01**2 + (0.002 * lever) ** 2
    np.testing.assert_allclose(result.covariance[2, 2], across, rtol=0.01)


def test_interpolation_averages_the_samples_noise_and_many_positions_share_it():
    robot = np.diag([4e-6] * 3 + [0.0001] * 3)
    platform = platform_with()
    for k in range(3):
        feed(platform, k * SECOND // 2, covariance=robot)
    half = platform.rig_pose(SECOND // 4, 'left')
    np.testing.assert_allclose(half.sample, 0.5 * robot)
    # Ten positions between two samples: together no better than one sample.
    tenth = platform.rig_pose(SECOND // 4 + SECOND // 20, 'left')
    np.testing.assert_allclose(tenth.sample, 10 * robot)


@pytest.mark.parametrize('apart', [0.31, 0.93, 1.07, 1.4, 5 / 3, 2.3])
def test_a_mean_of_many_positions_errs_as_the_sum_of_what_each_is_said_to(apart):
    """Positions `apart` samples from each other; samples err independently by 1 along x."""
    rng = np.random.default_rng(11)
    count = 400
    samples = int(count * apart) + 3
    errors = rng.normal(0, 1, (2000, samples))
    stated = 0.0
    mean = np.zeros(2000)
    platform = platform_with(position_std=1.0)
    for k in range(samples):
        feed(platform, k * PERIOD)
    for k in range(count):
        at = 0.37 + k * apart
        first, weight = int(at), at % 1.0
        mean += (1 - weight) * errors[:, first] + weight * errors[:, first + 1]
        stated += platform.rig_pose(round(at * PERIOD), 'left').sample[0, 0]
    assert abs((mean**2).mean() / stated - 1) < (0.1 if apart >= 1 else 0.2)


def walk(drift, noise, count=600, seed=3):
    """An odometry that drifts by `drift` per root second and has white noise beside, m."""
    rng = np.random.default_rng(seed)
    stated = (0.5**2) if drift else noise**2
    steps = rng.normal(0, drift * (PERIOD / SECOND) ** 0.5, (count, 3)).cumsum(axis=0)
    times = np.arange(count) * PERIOD / SECOND
    sway = 0.07 * np.sin(2 * np.pi * 0.4 * times)[:, None]
    places = sway + steps + rng.normal(0, noise, (count, 3))
    turns = Rotation.from_rotvec(
        0.08 * np.sin(2 * np.pi * 0.3 * times)[:, None] + rng.normal(0, 0.002, (count, 3))
    )
    covariance = np.diag([stated] * 3 + [0.002**2] * 3)
    platform = platform_with()
    for k in range(count):
        feed(platform, k * PERIOD, (places[k].tolist(), turns[k].as_quat().tolist()), covariance)
    return platform, covariance


def test_noise_that_is_white_goes_to_the_gain_whole():
    platform, covariance = walk(drift=0.0, noise=0.002)
    pose = platform.rig_pose(500 * PERIOD, 'left')
    assert pose.drift is None
    np.testing.assert_array_equal(pose.sample, covariance)


def test_drift_is_told_from_noise_and_kept_from_the_gain():
    platform, covariance = walk(drift=0.001, noise=0.002)
    pose = platform.rig_pose(500 * PERIOD, 'left')
    gain, slow = np.sqrt(np.diag(pose.sample)), np.sqrt(np.diag(pose.drift))
    np.testing.assert_allclose(gain[:3], 0.002, rtol=0.4)
    np.testing.assert_allclose(gain[3:], 0.002, rtol=1e-12)
    np.testing.assert_allclose(slow[:3], 0.5, rtol=1e-3)
    np.testing.assert_allclose(np.diag(pose.sample + pose.drift), np.diag(covariance), rtol=1e-12)
    carried = pose.carry(np.array([0, 0, 2.0]), np.eye(3) * 1e-6)
    assert np.trace(carried.covariance - carried.systematic) < 1e-4


@pytest.mark.parametrize('variances', [[0.0] * 6, [-1.0] + [1.0] * 5, [float('nan')] * 6])
def test_a_covariance_that_says_nothing_leaves_the_robot_exact(variances):
    platform = platform_with()
    feed(platform, 0, covariance=np.diag(variances))
    pose = platform.rig_pose(0, 'left')
    assert (pose.sample, pose.drift) == (None, None)


def test_odometry_of_another_frame_or_another_robot_is_refused():
    platform = platform_with()
    nothing = np.zeros((6, 6))
    odometry = platform.odometry
    assert "in the frame 'map', not in 'odom'" in odometry.add(0, 'map', 'b', *AT_REST, nothing)
    assert odometry.add(0, '/odom', 'base_link', *AT_REST, nothing) == ''
    assert "of 'other' beside" in odometry.add(1, 'odom', 'other', *AT_REST, nothing)
    bad = odometry.add(1, 'odom', 'base_link', (0, 0, 0), (0, 0, 0, 0), nothing)
    assert 'quaternion of length 0' in bad


def test_transforms_and_odometry_that_say_the_same_put_a_target_in_the_same_place():
    rng = np.random.default_rng(7)
    by_tf = Platform(FixedFrameOptions('odom', PlatformOptions(source='tf')))
    by_odometry = platform_with()
    by_tf.tree.add(0, 'base_link', 'left', MOUNTING[:3], MOUNTING[3:], static=True)
    for k in range(20):
        place = (rng.normal(0, 0.02, 3).tolist(), Rotation.from_rotvec(rng.normal(0, 0.02, 3)))
        place = place[0], place[1].as_quat().tolist()
        feed(by_odometry, k * PERIOD, place)
        by_tf.tree.add(k * PERIOD, 'odom', 'base_link', *place)
    for stamp in rng.integers(0, 19 * PERIOD, 50).tolist():
        one, other = (
            fixed(each, stamp, (0.1, 0.2, 3.0), np.eye(3)).point for each in (by_tf, by_odometry)
        )
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_positions_wait_for_the_robot_in_their_order_and_not_for_ever():
    platform = platform_with()
    room = WaitingRoom(platform, patience=0.2)
    feed(platform, 0)
    room.add('first', PERIOD // 2, 'left', now=0.0)
    room.add('second', PERIOD, 'left', now=0.1)
    assert list(room.ready(0.15)) == []
    feed(platform, PERIOD)
    assert [item for item, _ in room.ready(0.16)] == ['first', 'second']
    room.add('third', 2 * PERIOD, 'left', now=0.2)
    assert list(room.ready(0.39)) == []
    ((item, reason),) = room.ready(0.41)
    assert item == 'third'
    assert reason == 'the odometry ends 0.020 s before the image'
    # What can no longer come is not waited for.
    room.add('early', -PERIOD, 'left', now=0.5)
    ((item, reason),) = room.ready(0.5)
    assert (item, reason) == ('early', 'the odometry begins 0.020 s after the image')
    room.add('last', 3 * PERIOD, 'left', now=0.6)
    assert [item for item, _ in room.ready()] == ['last']


@pytest.mark.parametrize(
    ('make', 'told'),
    [
        (lambda: FixedFrameOptions('odom'), "set platform.source to 'tf' or 'odometry'"),
        (lambda: PlatformOptions(mounting=(0.0, 0, 0)), 'give seven'),
        (lambda: PlatformOptions(mounting=(0.0, 0, 0, 0, 0, 0, 2)), 'length 2'),
        (lambda: PlatformOptions(timeout=-1.0), 'timeout'),
        (lambda: PlatformOptions(source='gps'), 'source'),
    ],
)
def test_options_that_cannot_be_are_refused(make, told):
    with pytest.raises(PlatformError, match=told):
        make()


def test_options_are_read_only_parameters():
    for field in dataclasses.fields(PlatformOptions):
        assert field.metadata['read_only'], field.name


def test_transforms_tell_their_noise_themselves():
    rng = np.random.default_rng(8)
    position_std, rotation_std = 0.002, 0.001
    platform = Platform(FixedFrameOptions('odom', PlatformOptions(source='tf')))
    heading = Rotation.from_rotvec([0, 0, 1.2])
    # The robot's parent frame is turned in the fixed one, and so are the axes of its noise.
    turned = heading.as_quat().tolist()
    platform.tree.add(0, 'odom', 'dock', (5.0, 0, 0), turned, static=True)
    platform.tree.add(0, 'base_link', 'left', MOUNTING[:3], MOUNTING[3:], static=True)
    for k in range(400):
        sway = 0.07 * np.sin(2 * np.pi * 0.4 * k * PERIOD / SECOND)
        place = np.array([sway, 0, 0]) + rng.normal(0, position_std, 3) * [1, 1, 3]
        turn = Rotation.from_rotvec(rng.normal(0, rotation_std, 3)).as_quat().tolist()
        platform.tree.add(k * PERIOD, 'dock', 'base_link', place.tolist(), turn)
    pose = platform.rig_pose(350 * PERIOD, 'left')
    assert pose.drift is None
    deviations = np.sqrt(np.diag(pose.sample))
    np.testing.assert_allclose(deviations[:2], position_std, rtol=0.4)
    np.testing.assert_allclose(deviations[2], 3 * position_std, rtol=0.4)
    np.testing.assert_allclose(deviations[3:], rotation_std, rtol=0.4)
