"""The suite's messages: through their serialised form and back, and against ROS's own."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

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


def test_calibrations_survive_to_the_last_bit() -> None:
    received = through_cdr(messages.camera_info(STAMP, 'left', INFO))
    assert read_camera_info_message(received, 'left') == INFO


def test_images_keep_their_bytes() -> None:
    jpeg = bytes(range(256))
    assert through_cdr(messages.compressed_image(1, 'left', jpeg)).data.tobytes() == jpeg


def test_what_makes_no_message_is_refused() -> None:
    with pytest.raises(BagError, match='only 5 bytes'):
        messages.image(1, 'left', bytes(5), (4, 2), 'bgr8', 12)
