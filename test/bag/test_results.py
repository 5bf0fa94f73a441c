"""What the suite writes for every pair: read by `rosbags` and by ROS, which did not write it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from binopos_ros.bag import BagError, messages, results

STORE = get_typestore(Stores.ROS2_JAZZY)
STAMP = 1_700_000_000_123_456_789
#: Lengths that need every filling before the next number, letters of more than a byte too.
NAMES = ['', 'r', 'ri', 'rig', 'rig_', 'rig_l', 'rig_le', 'rig_left', 'Aufnahmegerät']
JOINT = np.arange(36.0).reshape(6, 6)

WRITTEN = {
    messages.POSE_WITH_COVARIANCE: lambda name: results.pose_with_covariance(
        STAMP, name, (1, 2, 3), np.diag([1.0, 4.0, 9.0]), (0.1, 0.2, 0.3, 0.9)
    ),
    messages.POSE: lambda name: results.pose(STAMP, name, (1, 2, 3)),
    messages.VECTOR3: lambda name: results.vector3(STAMP, name, (1.33, 0.01, 1)),
    messages.ODOMETRY: lambda name: results.odometry(
        STAMP, (name, f'{name}_child'), (1, 2, 3), JOINT, (4, 5, 6), 2 * JOINT
    ),
}


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('kind', WRITTEN)
def test_the_bytes_are_those_of_rosbags(kind: str, name: str) -> None:
    data = WRITTEN[kind](name)
    message = STORE.deserialize_cdr(data, kind)
    assert message.header.frame_id == name
    assert messages.stamp_of(message) == STAMP
    assert bytes(STORE.serialize_cdr(message, kind)) == data


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('kind', WRITTEN)
def test_ros_reads_them_and_writes_the_same(kind: str, name: str) -> None:
    serialization = pytest.importorskip('rclpy.serialization', reason='rclpy is not installed')
    interfaces = pytest.importorskip('binopos_ros.nodes.interfaces')
    data = WRITTEN[kind](name)
    message = serialization.deserialize_message(data, interfaces.installed_class(kind))
    assert message.header.frame_id == name
    # What fills up to the next number is left as it was in memory.
    written = STORE.deserialize_cdr(serialization.serialize_message(message), kind)
    assert bytes(STORE.serialize_cdr(written, kind)) == data


@settings(deadline=None)
@given(
    seconds=st.integers(0, 2**31 - 1),
    nanoseconds=st.integers(0, 10**9 - 1),
    position=st.tuples(*[st.floats(-1e6, 1e6)] * 3),
)
def test_stamps_and_positions_survive(
    seconds: int, nanoseconds: int, position: tuple[float, float, float]
) -> None:
    stamp, none = seconds * 10**9 + nanoseconds, np.zeros((3, 3))
    for kind, data in (
        (
            messages.POSE_WITH_COVARIANCE,
            results.pose_with_covariance(stamp, 'rig', position, none),
        ),
        (
            messages.ODOMETRY,
            results.odometry(stamp, ('rig', 'target'), position, none, position, none),
        ),
    ):
        received = STORE.deserialize_cdr(data, kind)
        assert messages.stamp_of(received) == stamp
        assert tuple(messages.position_of(received)) == position
        assert messages.orientation_of(received) == (0, 0, 0, 1)


def test_fields_land_where_ros_has_them() -> None:
    three = np.array([[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]])
    data = results.pose_with_covariance(1, 'rig', (0, 0, 0), three, (0.5, -0.5, 0.5, -0.5))
    received = STORE.deserialize_cdr(data, messages.POSE_WITH_COVARIANCE)
    full = messages.covariance_of(received)
    np.testing.assert_array_equal(full[:3, :3], three)
    assert not full[3:].any()
    assert messages.orientation_of(received) == (0.5, -0.5, 0.5, -0.5)

    odometry: Any = STORE.deserialize_cdr(
        results.odometry(1, ('odom', 'target'), (1, 2, 3), three, (4, 5, 6), JOINT),
        messages.ODOMETRY,
    )
    assert (odometry.header.frame_id, odometry.child_frame_id) == ('odom', 'target')
    np.testing.assert_array_equal(messages.covariance_of(odometry)[:3, :3], three)
    linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
    assert (linear.x, linear.y, linear.z) == (4, 5, 6)
    assert (angular.x, angular.y, angular.z) == (0, 0, 0)
    np.testing.assert_array_equal(odometry.twist.covariance.reshape(6, 6), JOINT)


def test_what_is_no_covariance_is_refused() -> None:
    with pytest.raises(BagError, match='covariance must be 3x3 or 6x6'):
        results.pose_with_covariance(1, 'rig', (0, 0, 0), np.eye(4))
