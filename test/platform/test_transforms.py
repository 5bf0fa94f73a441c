"""Rotations and transforms against scipy, and a tree of them against products by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from binopos_ros.platform import Limits, Missing, PlatformError, TransformTree
from binopos_ros.platform.quaternions import (
    matrix_of,
    of_rotation_vector,
    quaternion_of,
    rotation_vector,
    slerp,
)
from binopos_ros.platform.transforms import inverse, joined, transform_of

LIMITS = Limits(gap=0.5, speed=10.0, turn_rate=10.0)
NEVER_TURNED = (0.0, 0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)
SECOND = 10**9


def homogeneous(translation, quaternion):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = translation
    return matrix


def test_slerp_goes_the_way_of_another_implementation():
    rng = np.random.default_rng(1)
    for _ in range(50):
        ends = Rotation.random(2, random_state=rng)
        weight = rng.uniform()
        expected = Slerp([0, 1], ends)([weight])[0]
        first, second = (tuple(each) for each in ends.as_quat())
        # The same rotation under its other sign too.
        for sign in (1, -1):
            own = slerp(first, tuple(sign * value for value in second), weight)
            assert (Rotation.from_quat(own) * expected.inv()).magnitude() < 1e-7


def test_matrices_quaternions_and_rotation_vectors_are_those_of_another_implementation():
    rng = np.random.default_rng(2)
    turns = [*Rotation.random(50, random_state=rng), Rotation.from_rotvec([0, np.pi, 0])]
    for turn in turns:
        own = quaternion_of(turn.as_matrix())
        np.testing.assert_allclose(matrix_of(own), turn.as_matrix(), atol=1e-12)
        vector = np.array(rotation_vector(own))
        again = matrix_of(of_rotation_vector(vector))
        np.testing.assert_allclose(again, turn.as_matrix(), atol=1e-12)


def test_transforms_join_and_turn_round_as_their_matrices_do():
    rng = np.random.default_rng(3)
    a, b = (
        transform_of(rng.normal(size=3), Rotation.random(random_state=rng).as_quat())
        for _ in range(2)
    )
    product = homogeneous(*a) @ homogeneous(*b)
    np.testing.assert_allclose(homogeneous(*joined(a, b)), product, atol=1e-12)
    np.testing.assert_allclose(
        homogeneous(*inverse(a)), np.linalg.inv(homogeneous(*a)), atol=1e-12
    )


@pytest.mark.parametrize(
    ('translation', 'rotation', 'told'),
    [
        (ORIGIN, (0, 0, 0, 0.5), 'length 0.5'),
        (ORIGIN, (0, 0, 0, 0), 'length 0'),
        (ORIGIN, (0, 0, float('nan'), 1), 'not finite'),
        ((float('inf'), 0, 0), NEVER_TURNED, 'not finite'),
    ],
)
def test_what_is_no_transform_is_refused(translation, rotation, told):
    with pytest.raises(PlatformError, match=told):
        transform_of(translation, rotation)


def test_a_quaternion_rounded_to_a_few_digits_is_brought_to_length_one():
    rounded = np.round(Rotation.from_rotvec([0.3, -0.2, 0.9]).as_quat(), 3)
    assert abs(np.linalg.norm(transform_of(ORIGIN, rounded).rotation) - 1) < 1e-15


def random_transform(rng):
    return rng.normal(size=3).tolist(), Rotation.random(random_state=rng).as_quat().tolist()


def test_a_chain_goes_up_and_down_the_tree_and_between_samples():
    rng = np.random.default_rng(4)
    tree = TransformTree(LIMITS)
    to_base = random_transform(rng)
    mount, optical, odom = (random_transform(rng) for _ in range(3))
    # base_link turns at a constant rate and moves straight on.
    rate, velocity = np.array([0.2, -0.1, 0.3]), np.array([0.4, 0.1, -0.2])
    start = Rotation.from_quat(to_base[1])

    def base(seconds):
        turn = Rotation.from_rotvec(rate * seconds) * start
        return (np.array(to_base[0]) + velocity * seconds).tolist(), turn.as_quat().tolist()

    for k in range(11):
        assert tree.add(k * SECOND // 10, 'map', 'base_link', *base(k / 10)) == ''
    assert tree.add(0, 'base_link', '/mount', *mount, static=True) == ''
    assert tree.add(0, 'mount', 'left', *optical, static=True) == ''
    # The fixed frame hangs beside the robot, not above it.
    assert tree.add(0, 'map', 'odom', *odom, static=True) == ''
    placed = tree.rig_in('odom', 'left', 537_000_000, moving=True)
    assert not isinstance(placed, Missing)

    def expected(seconds):
        there = homogeneous(*base(seconds)) @ homogeneous(*mount) @ homogeneous(*optical)
        return np.linalg.inv(homogeneous(*odom)) @ there

    np.testing.assert_allclose(homogeneous(*placed.pose), expected(0.537), atol=1e-9)
    pivot = np.linalg.inv(homogeneous(*odom)) @ [*base(0.537)[0], 1]
    np.testing.assert_allclose(placed.pivot, pivot[:3], atol=1e-9)
    # How fast it moves, against a difference of the closed form.
    move = (expected(0.637)[:3, 3] - expected(0.537)[:3, 3]) / 0.1
    np.testing.assert_allclose(placed.velocity, move, atol=1e-9)
    back = Rotation.from_quat(odom[1]).inv()
    np.testing.assert_allclose(placed.turn, back.apply(rate), atol=1e-9)


def told(tree, stamp=SECOND, fixed='odom', rig='left'):
    found = tree.rig_in(fixed, rig, stamp, moving=False)
    assert isinstance(found, Missing)
    return found


@pytest.fixture
def tree():
    """A robot at rest whose pose in odom comes ten times a second, for a second."""
    made = TransformTree(LIMITS)
    for k in range(10):
        assert made.add(k * SECOND // 10, 'odom', 'base_link', ORIGIN, NEVER_TURNED) == ''
    assert made.add(0, 'base_link', 'left', ORIGIN, NEVER_TURNED, static=True) == ''
    return made


def test_nothing_is_extrapolated_and_what_may_still_come_is_waited_for(tree):
    assert not isinstance(tree.rig_in('odom', 'left', 9 * SECOND // 10, moving=False), Missing)
    late = told(tree)
    assert late.may_come
    assert "'odom' -> 'base_link' ends 0.100 s before the image" in late.reason
    early = told(tree, stamp=-1)
    assert not early.may_come
    assert 'after the image' in early.reason


def test_a_gap_is_not_bridged_and_a_jump_not_walked(tree):
    assert tree.add(2 * SECOND, 'odom', 'base_link', ORIGIN, NEVER_TURNED) == ''
    gap = told(tree, stamp=3 * SECOND // 2)
    assert (gap.may_come, 'gap of 1.100 s' in gap.reason) == (False, True)
    assert tree.add(21 * SECOND // 10, 'odom', 'base_link', (3.0, 0, 0), NEVER_TURNED) == ''
    jump = told(tree, stamp=2 * SECOND + 50_000_000)
    assert (jump.may_come, 'jumps by 3.000 m' in jump.reason) == (False, True)
    about = (1.0, 0.0, 0.0, 0.0)
    assert tree.add(22 * SECOND // 10, 'odom', 'base_link', (3.0, 0, 0), about) == ''
    assert 'jumps by 3.142 rad' in told(tree, stamp=2 * SECOND + 150_000_000).reason
    # Only the pairs between are lost.
    for stamp in (SECOND // 2, 2 * SECOND, 21 * SECOND // 10, 22 * SECOND // 10):
        assert not isinstance(tree.rig_in('odom', 'left', stamp, moving=False), Missing)


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (('odom', 'base_link', ORIGIN, (0, 0, 0, 2.0)), 'quaternion of length 2'),
        (('map', 'base_link', ORIGIN, NEVER_TURNED), "two parents: 'odom' and now 'map'"),
        (('left', 'odom', ORIGIN, NEVER_TURNED), 'in a circle: odom -> base_link -> left -> odom'),
        (('odom', 'odom', ORIGIN, NEVER_TURNED), 'in a circle'),
        (('', 'odom', ORIGIN, NEVER_TURNED), 'names no frame'),
        (('base_link', 'left', (1.0, 0, 0), NEVER_TURNED), 'static and comes as a moving one'),
    ],
)
def test_what_cannot_be_is_refused_with_its_reason_and_harms_nothing(tree, arguments, reason):
    before = tree.rig_in('odom', 'left', SECOND // 2, moving=False)
    assert reason in tree.add(SECOND, *arguments)
    assert tree.rig_in('odom', 'left', SECOND // 2, moving=False).pose == before.pose


def test_two_poses_for_one_stamp_are_a_contradiction_the_same_one_is_not(tree):
    assert tree.add(SECOND // 2, 'odom', 'base_link', ORIGIN, NEVER_TURNED) == ''
    reason = tree.add(SECOND // 2, 'odom', 'base_link', (1.0, 0, 0), NEVER_TURNED)
    assert 'told twice for one stamp' in reason
    assert tree.rig_in('odom', 'left', SECOND // 2, moving=False).pose.translation == ORIGIN
    assert 'has changed' in tree.add(0, 'base_link', 'left', (1, 0, 0), NEVER_TURNED, static=True)


def test_a_sample_that_comes_late_is_filed_in_and_a_clock_set_back_begins_afresh(tree):
    assert tree.add(85 * SECOND // 100, 'odom', 'base_link', (0.1, 0, 0), NEVER_TURNED) == ''
    there = tree.rig_in('odom', 'left', 85 * SECOND // 100, moving=False)
    assert there.pose.translation == (0.1, 0.0, 0.0)
    # As a bag that is played in a loop.
    assert tree.add(-5 * SECOND, 'odom', 'base_link', (2.0, 0, 0), NEVER_TURNED) == ''
    assert told(tree, stamp=SECOND // 2).may_come


def test_frames_that_do_not_exist_are_named_with_those_that_do(tree):
    assert told(TransformTree(LIMITS)).reason == 'no transform has come'
    reason = told(tree, rig='rigth').reason
    assert "the frame 'rigth'; known: base_link, left, odom" in reason
    tree.add(0, 'world', 'buoy', ORIGIN, NEVER_TURNED, static=True)
    assert told(tree, fixed='buoy').reason == "no transforms lead from 'buoy' to 'left'"


def test_memory_does_not_grow_with_the_hours():
    tree = TransformTree(LIMITS)
    for k in range(5000):
        tree.add(k * SECOND // 10, 'odom', 'base_link', ORIGIN, NEVER_TURNED)
    assert len(tree._edges['base_link'].history.stamps) < 250
