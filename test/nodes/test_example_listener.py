"""The example that takes the target's pose hears it."""

from __future__ import annotations

import runpy
import time
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402

pytestmark = pytest.mark.live

EXAMPLE = Path(__file__).resolve().parents[2] / 'examples' / 'subscribe_pose.py'
PATIENCE = 20.0


def test_the_listener_prints_the_pose_and_how_sure_it_is(peer, capsys):
    message = PoseWithCovarianceStamped()
    message.pose.pose.position.z = 1.25
    message.pose.covariance[14] = 4e-6
    publisher = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    rclpy.init()
    listener = runpy.run_path(str(EXAMPLE))['Listener']()
    try:
        deadline = time.monotonic() + PATIENCE
        while not listener.heard and time.monotonic() < deadline:
            publisher.publish(message)
            rclpy.spin_once(listener, timeout_sec=0.05)
    finally:
        listener.destroy_node()
        rclpy.try_shutdown()
    assert '+0.000 +0.000 +1.250 m, depth +- 2.0 mm' in capsys.readouterr().out
