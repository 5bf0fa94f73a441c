"""What `binopos run` says in the terminal is what the topics say."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped

pytestmark = pytest.mark.live

LINE = 'tracking  '


def test_a_run_shows_the_pose_and_its_health_on_a_terminal(peer, ros_domain):
    poses = peer.publisher(PoseWithCovarianceStamped, 'target/pose')
    words = peer.publisher(DiagnosticStatus, 'target/health')
    pose = PoseWithCovarianceStamped()
    pose.pose.pose.position.x, pose.pose.pose.position.z = -0.1234, 1.25
    pose.pose.covariance[14] = 4e-6
    terminal, theirs = pty.openpty()
    run = subprocess.Popen(
        [sys.executable, '-m', 'binopos_ros', 'run', '--nodes', 'detector'],
        stdout=theirs,
        stderr=subprocess.PIPE,
    )
    os.close(theirs)
    os.set_blocking(terminal, False)
    shown = ''

    def told() -> bool:
        nonlocal shown
        poses.publish(pose)
        words.publish(DiagnosticStatus(message='tracking'))
        try:
            shown += os.read(terminal, 1 << 16).decode()
        except BlockingIOError:
            return False
        # In place: one row, which is erased before it is written again.
        return shown.count(f'\r\x1b[K{LINE}') > 0 and shown.count('\r\x1b[K') > 1

    try:
        peer.wait_for(told, 'the status')
        assert ' -0.1234 0.0000 1.2500 m ±0.00 0.00 2.0 mm' in shown
        assert '\n' not in shown
        run.send_signal(signal.SIGINT)
        assert run.wait(20) == 0
    finally:
        run.kill()
        run.communicate()
        os.close(terminal)
