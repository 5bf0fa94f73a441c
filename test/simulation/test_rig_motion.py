"""A robot that carries the rig: what it sees, what it tells of itself, and the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from binopos_ros.bag import BagReader, messages
from binopos_ros.cli.simulated_bag import record
from binopos_ros.simulation import Choices, SimulationError, ports
from binopos_ros.simulation.rig_motion import MOTIONS, Odometer, mounting, rig_motion

ODOMETER = Odometer(position_std=0.002, rotation_std=0.001, rate=50.0)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Two pairs of a rig that hovers before a target at rest."""
    folder = tmp_path_factory.mktemp('robot') / 'bag'
    choices = Choices(path='still', motion='hover', odometer=ODOMETER, seed=5)
    record(ports(choices), folder, 2, seed=5)
    return folder


def read(bag, topic):
    with BagReader(bag) as reader:
        return [reader.decode(each) for each in reader.messages([topic])]


def homogeneous(place, turn):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(turn).as_matrix(), place
    return matrix


@pytest.mark.parametrize('kind', MOTIONS)
def test_a_target_at_rest_stays_in_one_place_of_the_fixed_frame(kind):
    scene = ports(Choices(path='still', motion=kind))
    times = np.linspace(0, 20, 50)
    fixed = scene.path.fixed(times)[0]
    np.testing.assert_allclose(fixed, fixed[:1].repeat(50, axis=0), atol=1e-12)
    seen, normals = scene.path.poses(times)
    assert np.ptp(seen, axis=0).max() > 0.05
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-12)
    places, turns = scene.path.motion.poses(times)
    for point, place, turn, expected in zip(seen, places, turns, fixed, strict=True):
        mount = homogeneous(mounting()[:3], mounting()[3:])
        there = homogeneous(place, turn) @ mount @ [*point, 1]
        np.testing.assert_allclose(there[:3], expected, atol=1e-12)


def test_the_bag_s_transforms_lead_from_the_truth_in_one_frame_to_that_in_the_other(bag):
    truth, fixed = (read(bag, f'/stereo/truth/{name}') for name in ('pose', 'fixed_pose'))
    told = [one for each in read(bag, '/tf_static') for one in messages.transforms_of(each)]
    static = {child: (parent, place, turn) for _, parent, child, place, turn in told}
    moving = [one for each in read(bag, '/tf') for one in messages.transforms_of(each)]
    odometry = read(bag, '/stereo/platform/odometry')
    assert fixed[0].header.frame_id == 'odom'
    assert (odometry[0].header.frame_id, odometry[0].child_frame_id) == ('odom', 'base_link')
    for message, (stamp, _, _, place, turn) in zip(odometry, moving, strict=True):
        assert messages.stamp_of(message) == stamp
        np.testing.assert_array_equal(messages.position_of(message), place)
        np.testing.assert_array_equal(messages.orientation_of(message), turn)
        np.testing.assert_allclose(
            messages.covariance_of(message), np.diag([4e-6] * 3 + [1e-6] * 3), atol=1e-18
        )
    first = messages.stamp_of(truth[0])
    robot = next(each for each in moving if each[0] == first)
    left = truth[0].header.frame_id
    mount = homogeneous(*static[left][1:])
    seen = homogeneous(*robot[3:]) @ mount @ [*messages.position_of(truth[0]), 1]
    # Within what the odometry errs at this range.
    assert np.linalg.norm(seen[:3] - messages.position_of(fixed[0])) < 0.015
    assert static['right_camera_optical_frame'][0] == left


def test_the_odometry_errs_as_its_covariance_says():
    motion = rig_motion('hover', np.random.default_rng(1))
    times = np.arange(0, 100, 0.02)
    places, turns = motion.poses(times)
    samples = ODOMETER.samples(motion, times, np.random.default_rng(2))
    errors = np.array([place for place, _ in samples]) - places
    measured = Rotation.from_quat([turn for _, turn in samples])
    turned = (measured * Rotation.from_quat(turns).inv()).as_rotvec()
    np.testing.assert_allclose(errors.std(axis=0), 0.002, rtol=0.05)
    np.testing.assert_allclose(turned.std(axis=0), 0.001, rtol=0.05)


def test_what_cannot_be_is_refused():
    with pytest.raises(SimulationError, match='no motion of a robot'):
        rig_motion('fly', np.random.default_rng(0))
    with pytest.raises(SimulationError, match='leave one of the two out'):
        ports(Choices(motion='hover', swing=0.1))
    with pytest.raises(SimulationError, match='position_std'):
        Odometer(position_std=-1.0)
