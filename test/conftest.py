"""Fixtures that every room's tests share: the real data, and a ROS domain of one's own."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
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


@pytest.fixture(scope='session')
def locked_domain() -> Iterator[int]:
    """A ROS domain that this process has to itself for as long as it runs."""
    # Domains above 101 collide with the ephemeral ports of Linux.
    for number in range(100):
        domain = 1 + (os.getpid() + number) % 100
        path = Path(tempfile.gettempdir()) / f'binopos_test_domain_{domain}.lock'
        try:
            lock = path.open('w')
        except OSError:
            # Another user's.
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        yield domain
        lock.close()
        return
    pytest.fail('every ROS domain is taken by another run of the tests')


@pytest.fixture
def ros_domain(locked_domain: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> int:
    """A ROS domain that no other test on this machine talks on, confined to this machine."""
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(locked_domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
    return locked_domain
