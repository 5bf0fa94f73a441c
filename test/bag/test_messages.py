"""The suite's messages: through their serialised form and back, and against ROS's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.bag import BagError, messages
from binopos_ros.bag.definitions import jazzy
from binopos_ros.optics.camera_info import CameraInfo, Roi
from binopos_ros.optics.camera_info_message import read_camera_info_message

STAMP = 1_700_000_000_123_456_789
INFO = CameraInfo(
    'left', 1280, 960, 'rational_polynomial', (0.1, -0.2, 1e-3, 2e-3, 0.05, 0.0, 0.1, 0.2),
    (900.5, 0.0, 640.25, 0.0, 901.5, 480.75, 0.0, 0.0, 1.0),
    p=(900.0, 0.0, 640.0, -207.0, 0.0, 900.0, 480.0, 0.0, 0.0, 0.0, 1.0, 0.0),
    binning=(2, 2), roi=Roi(4, 6, 100, 200, True),
)  # fmt: skip

BUILT = [
    messages.compressed_image(STAMP, 'left', b'\xff\xd8jpeg\xff\xd9'),
    messages.image(STAMP, 'left', bytes(range(24)), (4, 2), 'bgr8', 12),
    messages.camera_info(STAMP, 'left', INFO),
    messages.pose_with_covariance(STAMP, 'rig', (1, 2, 3), np.diag([1.0, 4.0, 9.0])),
    messages.pose(STAMP, 'rig', (1, 2, 3)),
    messages.vector3(STAMP, 'rig', (1.33, 0.01, 1)),
    messages.odometry(STAMP, 'rig', (1, 2, 3), (4, 5, 6), np.diag(np.arange(1.0, 7.0))),
]


def through_cdr(message: Any) -> Any:
    store = jazzy()
    return store.deserialize_cdr(
        store.serialize_cdr(message, message.__msgtype__), message.__msgtype__
    )


@pytest.mark.parametrize('message', BUILT, ids=lambda message: message.__msgtype__)
def test_ros_and_we_read_each_other(message: Any) -> None:
    serialization = pytest.importorskip('rclpy.serialization', reason='rclpy is not installed')
    interfaces = pytest.importorskip('binopos_ros.nodes.interfaces')
    data = bytes(jazzy().serialize_cdr(message, message.__msgtype__))
    received = serialization.deserialize_message(
        data, interfaces.installed_class(message.__msgtype__)
    )
    assert_same(received, message)
    back = jazzy().deserialize_cdr(serialization.serialize_message(received), message.__msgtype__)
    assert_same(received, back)


def assert_same(received: Any, sent: Any) -> None:
    for name in received.get_fields_and_field_types():
        ours, theirs = getattr(sent, name), getattr(received, name)
        if hasattr(theirs, 'get_fields_and_field_types'):
            assert_same(theirs, ours)
        elif isinstance(theirs, (int, float, str)):
            assert theirs == ours
        else:
            np.testing.assert_array_equal(np.asarray(theirs), np.asarray(ours))


@settings(deadline=None)
@given(
    seconds=st.integers(0, 2**31 - 1),
    nanoseconds=st.integers(0, 10**9 - 1),
    position=st.tuples(*[st.floats(-1e6, 1e6)] * 3),
)
def test_stamps_and_positions_survive(
    seconds: int, nanoseconds: int, position: tuple[float, float, float]
) -> None:
    stamp = seconds * 10**9 + nanoseconds
    for message in (
        messages.pose(stamp, 'rig', position),
        messages.pose_with_covariance(stamp, 'rig', position, np.eye(3)),
        messages.odometry(stamp, 'rig', position, position, np.eye(6)),
    ):
        received = through_cdr(message)
        assert messages.stamp_of(received) == stamp
        assert tuple(messages.position_of(received)) == position
        assert received.header.frame_id == 'rig'


def test_calibrations_survive_to_the_last_bit() -> None:
    received = through_cdr(messages.camera_info(STAMP, 'left', INFO))
    assert read_camera_info_message(received, 'left') == INFO


def test_covariances_land_in_the_rows_of_ros() -> None:
    three = np.array([[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]])
    full = messages.covariance_of(
        through_cdr(messages.pose_with_covariance(1, 'rig', (0, 0, 0), three))
    )
    np.testing.assert_array_equal(full[:3, :3], three)
    assert not full[3:].any()
    joint = np.arange(36.0).reshape(6, 6)
    odometry = through_cdr(messages.odometry(1, 'rig', (0, 0, 0), (0, 0, 0), joint))
    np.testing.assert_array_equal(messages.covariance_of(odometry)[:3, :3], joint[:3, :3])
    velocity = np.asarray(odometry.twist.covariance).reshape(6, 6)
    np.testing.assert_array_equal(velocity[:3, :3], joint[3:, 3:])


def test_images_keep_their_bytes() -> None:
    jpeg = bytes(range(256))
    assert through_cdr(messages.compressed_image(1, 'left', jpeg)).data.tobytes() == jpeg


def test_what_makes_no_message_is_refused() -> None:
    with pytest.raises(BagError, match='covariance must be 3x3 or 6x6'):
        messages.pose_with_covariance(1, 'rig', (0, 0, 0), np.eye(4))
    with pytest.raises(BagError, match='only 5 bytes'):
        messages.image(1, 'left', bytes(5), (4, 2), 'bgr8', 12)
