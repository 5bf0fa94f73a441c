"""Message classes come from installed interface packages, whatever a bag or the network names."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed')

from binopos_ros.bag import BagWriter
from binopos_ros.bag.definitions import Definition
from binopos_ros.nodes.interfaces import installed_class


def test_an_installed_type_is_found() -> None:
    from sensor_msgs.msg import Image

    assert installed_class('sensor_msgs/msg/Image') is Image


@pytest.mark.parametrize(
    'name',
    [
        '/msg/X',
        'x',
        '',
        'sensor_msgs/msg/',
        'sensor_msgs/msg/Nothing',
        'sensor_msgs/msg/__doc__',
        'sensor_msgs/srv/SetCameraInfo',
        'nowhere_msgs/msg/Image',
        '../sensor_msgs/msg/Image',
        '.sensor_msgs/msg/Image',
        'os/msg/Path',
        'sensor_msgs/msg/Image/msg/Image',
        'sensor_msgs\x00/msg/Image',
    ],
)
def test_anything_else_is_none(name: str) -> None:
    assert installed_class(name) is None


EVIL = 'from pathlib import Path\nPath({mark!r}).touch()\n'
STORE = 'string data\n'


@pytest.fixture
def mark(tmp_path: Path) -> Path:
    """A file that appears once the package `evilpkg` of a working folder was imported."""
    mark = tmp_path / 'imported'
    for package in ('evilpkg', 'sensor_msgs'):
        for folder in (tmp_path / 'work' / package, tmp_path / 'work' / package / 'msg'):
            folder.mkdir(parents=True, exist_ok=True)
            (folder / '__init__.py').write_text(EVIL.format(mark=str(mark)) + 'class X: pass\n')
    return mark


def in_working_folder(mark: Path, name: str) -> str:
    """What a process that starts in that folder, which Python searches first, makes of a name."""
    code = (
        'from binopos_ros.nodes.interfaces import installed_class\n'
        f'print(installed_class({name!r}))'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        cwd=mark.parent / 'work',
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize('name', ['evilpkg/msg/X', 'sensor_msgs/msg/Image'])
def test_a_package_of_the_working_folder_is_never_imported(mark: Path, name: str) -> None:
    assert in_working_folder(mark, name) == 'None'
    assert not mark.exists()


@pytest.mark.live
@pytest.mark.parametrize('name', ['evilpkg/msg/X', '/msg/X'])
def test_a_bag_that_names_such_a_type_is_one_line(mark: Path, name: str, ros_domain: int) -> None:
    bag = mark.parent / 'bag'
    with BagWriter(bag) as writer:
        writer.add_topic('/evil', name, definition=Definition('ros2msg', STORE, ''))
        writer.write('/evil', 5, b'\0\1\0\0\0\0\0\0')
    done = subprocess.run(
        [
            *(sys.executable, '-m', 'binopos_ros.nodes', 'player'),
            *('--ros-args', '-p', f'bag:={bag}'),
        ],
        cwd=mark.parent / 'work',
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert 'is not installed' in done.stderr
    assert 'Traceback' not in done.stderr
    assert not mark.exists()
