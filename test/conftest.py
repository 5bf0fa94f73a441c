"""Fixtures that every room's tests share: the real data, and a ROS domain of one's own."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope='session')
def project() -> Path:
    """The project's root."""
    return PROJECT


@pytest.fixture(scope='session')
def shared_data() -> Path:
    """Folder of the real data beside the project; the test skips where it is absent."""
    folder = PROJECT.parent / 'shared' / 'data'
    if not folder.is_dir():
        pytest.skip('the real data is absent: ../shared/data does not exist')
    return folder


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """A ROS domain that no other test on this machine talks on, confined to this machine."""
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    # Domains above 101 collide with the ephemeral ports of Linux; processes differ in their pid.
    domain = 1 + os.getpid() % 100
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
    return domain
