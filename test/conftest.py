"""Fixtures that every room's tests share: the real data, and a ROS domain of one's own."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent
#: Seconds that processes have to end after a test.
PATIENCE = 10.0
#: Variables through which Python and ROS find packages.
OF_ROS = ('AMENT_PREFIX_PATH', 'LD_LIBRARY_PATH', 'PYTHONPATH')

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    # As a shell starts what it puts into the background; the tests' processes would inherit it.
    signal.signal(signal.SIGINT, signal.default_int_handler)


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
def ros_domain(
    locked_domain: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Iterator[int]:
    """A ROS domain that no other test on this machine talks on, confined to this machine.

    A test that leaves a process there fails: the next one would hear it.
    """
    pytest.importorskip('rclpy', reason='rclpy is not installed')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(locked_domain))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'ros_log'))
    yield locked_domain
    deadline = time.monotonic() + PATIENCE
    while (left := _started_with('ROS_LOG_DIR', str(tmp_path / 'ros_log'))) and (
        time.monotonic() < deadline
    ):
        time.sleep(0.02)
    for pid in left:
        os.kill(pid, signal.SIGKILL)
    assert not left, f'processes were left running: {left}'


def _started_with(name: str, value: str) -> dict[int, str]:
    """Other processes that began with a variable of that value: id -> command line."""
    found = {}
    for entry in Path('/proc').glob('[0-9]*'):
        try:
            variables = (entry / 'environ').read_bytes().split(b'\0')
            words = (entry / 'cmdline').read_bytes().replace(b'\0', b' ').decode()
        except OSError:
            continue
        # One that has ended and that nobody has waited for has no command line.
        if f'{name}={value}'.encode() in variables and words and int(entry.name) != os.getpid():
            found[int(entry.name)] = words
    return found


@pytest.fixture(scope='session')
def tf_environment() -> dict[str, str]:
    """Variables with which processes find type support for tf2_msgs, which no wheel has.

    It is built once for each version of Python, in a minute, by the recipe beside the project;
    the test skips where that, a compiler or the registry is absent.
    """
    recipe = PROJECT.parent / 'shared' / 'tf-lab' / 'build.sh'
    if not recipe.is_file():
        pytest.skip('tf2_msgs cannot be built: ../shared/tf-lab does not exist')
    folder = PROJECT / '.venv' / f'tf2_msgs-py{sys.version_info.major}.{sys.version_info.minor}'
    variables = folder / 'env.sh'
    if not variables.is_file():
        clean = {name: value for name, value in os.environ.items() if name not in OF_ROS}
        done = subprocess.run(
            ['bash', str(recipe), str(folder), sys.executable],
            capture_output=True,
            text=True,
            check=False,
            env=clean,
        )
        if done.returncode:
            told = (done.stderr.strip() or done.stdout.strip() or 'no output').splitlines()[-1]
            pytest.skip(f'tf2_msgs cannot be built here: {told}')
    # As a shell reads it: before what the wheels have put there for the libraries of their own.
    listed = subprocess.run(
        ['bash', '-c', f'. {variables}; env -0'], capture_output=True, text=True, check=True
    ).stdout
    found = dict(each.split('=', 1) for each in listed.split('\0') if '=' in each)
    return {name: found[name].rstrip(':') for name in OF_ROS if name in found}
