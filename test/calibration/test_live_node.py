"""`binopos calibrate stereo --live` as a process, fed with real pictures over ROS topics."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

PATIENCE = 90.0
VERB = ('calibrate', 'stereo', '--live')


@pytest.fixture
def peer(ros_domain: int) -> Any:
    """A node of the test's own in /stereo."""
    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('test_peer', namespace='stereo', context=context)
    yield node
    node.destroy_node()
    rclpy.try_shutdown(context=context)


def test_live_pictures_become_a_calibration(peer: Any, samples: Path, tmp_path: Path) -> None:
    from sensor_msgs.msg import CompressedImage

    executor = rclpy.executors.SingleThreadedExecutor(context=peer.context)
    executor.add_node(peer)
    publishers = {
        side: peer.create_publisher(CompressedImage, f'{side}/image_raw/compressed', 10)
        for side in ('left', 'right')
    }
    overlays: list[Any] = []
    peer.create_subscription(
        CompressedImage, 'calibration/overlay/compressed', overlays.append, 10
    )
    words = ['--square', '0.025', '--wanted', '1e-6', '--distance', '0.4', '-o']
    process = subprocess.Popen(
        [sys.executable, '-u', '-m', 'binopos_ros', *VERB, *words, str(tmp_path / 'cal')],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        end = time.monotonic() + PATIENCE
        while publishers['left'].get_subscription_count() == 0:
            assert time.monotonic() < end
            assert process.poll() is None
            executor.spin_once(timeout_sec=0.1)
        stamp = 1000.0
        for left in sorted(samples.glob('left0*.jpg')):
            seen = len(overlays)
            # Until it has been looked at twice: once moving, once at rest.
            while len(overlays) < seen + 2 and time.monotonic() < end:
                stamp += 0.1
                for side, publisher in publishers.items():
                    message = CompressedImage(format='jpeg')
                    message.data = (left.parent / left.name.replace('left', side)).read_bytes()
                    message.header.stamp.sec = int(stamp)
                    message.header.stamp.nanosec = int(stamp % 1.0 * 1e9)
                    publisher.publish(message)
                executor.spin_once(timeout_sec=0.1)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        executor.shutdown()
    assert process.returncode == 0, errors
    assert 'taken' in output
    assert 'next: ' in output
    assert 'held-out RMS' in output
    assert (tmp_path / 'cal' / 'left.yaml').is_file()
    picture = np.frombuffer(overlays[-1].data, np.uint8)
    assert bytes(picture[:2]) == b'\xff\xd8'
