"""What verbs leave behind: whole outputs or none, and a line where ROS or the place is missing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from binopos_ros.cli import outputs, progress
from verbs import binopos, command, simulated

pytestmark = pytest.mark.xdist_group('outputs')

PAIRS = 60


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulated(tmp_path_factory.mktemp('outputs') / 'bag', 'demo', PAIRS)


def test_a_process_that_fails_or_is_interrupted_leaves_nothing(bag, tmp_path):
    out, table = tmp_path / 'out.mcap', tmp_path / 'out.csv'
    words = ('process', bag, '-o', out, '--csv', table)
    done = binopos(*words, '--ros-args', '-p', 'triangulator:calibration_covariance:=/absent')
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []
    running = subprocess.Popen(command(*words), stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 30.0
    while not list(tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.01)
    running.send_signal(signal.SIGINT)
    _, errors = running.communicate(timeout=30)
    if running.returncode:
        assert running.returncode == 130, errors
        assert list(tmp_path.iterdir()) == []
        assert errors == ''
    # It did not block the next try.
    for path in tmp_path.iterdir():
        path.unlink()
    assert binopos(*words).returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ['out.csv', 'out.mcap']


def test_what_is_there_is_replaced_only_by_force(bag, tmp_path):
    out, table = tmp_path / 'out', tmp_path / 'out.csv'
    table.write_text('precious')
    words = ('process', bag, '-o', out, '--csv', table)
    done = binopos(*words)
    assert done.returncode == 2
    assert 'out.csv exists already: choose another name, or replace it with --force' in done.stderr
    assert table.read_text() == 'precious'
    assert not out.exists()
    out.mkdir()
    (out / 'old').touch()
    done = binopos(*words, '--force')
    assert done.returncode == 0, done.stderr
    assert table.read_text().startswith('stamp,')
    assert sorted(path.name for path in out.iterdir()) == ['metadata.yaml', 'out_0.mcap']


@pytest.mark.parametrize(
    'words', [('run',), ('replay', 'BAG'), ('record', '-o', 'OUT'), ('calibrate', 'LIVE')]
)
def test_without_ros_a_verb_that_needs_it_says_so_in_one_line(bag, tmp_path, words):
    live = ('stereo', '--live', '--board', '9x6', '--square', '0.025', '-o', tmp_path / 'cal')
    given = [
        bag if word == 'BAG' else tmp_path / word if word == 'OUT' else word for word in words
    ]
    if words[1:] == ('LIVE',):
        given[1:] = map(str, live)
    done = without_ros(given)
    assert done.returncode == 2, done.stderr
    assert done.stderr.count('\n') == 1, done.stderr
    assert 'is not there for this Python: source /opt/ros' in done.stderr


@pytest.mark.parametrize('verb', ['run', 'replay', 'record', 'calibrate', 'process', 'doctor'])
def test_the_help_of_every_verb_needs_no_ros(verb):
    done = without_ros([verb, '--help'])
    assert done.returncode == 0, done.stderr
    assert f'usage: binopos {verb}' in done.stdout


def without_ros(words: list[object]) -> subprocess.CompletedProcess[str]:
    """A verb in a Python that has none of ROS's packages."""
    hidden = ('rclpy', 'sensor_msgs', 'geometry_msgs', 'std_msgs', 'rcl_interfaces')
    script = (
        f'import sys\nfor name in {hidden}: sys.modules[name] = None\n'
        f'from binopos_ros.cli import main\nsys.exit(main({list(map(str, words))}))'
    )
    return subprocess.run(
        [sys.executable, '-c', script],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def test_no_module_of_the_working_folder_is_imported(bag, tmp_path):
    """Neither by the verb nor by the nodes that it starts."""
    for name in ('statistics', 'cv2', 'numpy', 'yaml', 'csv', 'rclpy', 'queue'):
        (tmp_path / f'{name}.py').write_text('open("hijacked", "w"); raise SystemExit(9)')
    done = binopos('process', bag, '-o', 'out.mcap', cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    from binopos_ros.nodes.supervised import STARTER

    done = subprocess.run(
        [sys.executable, STARTER, 'smoother', '--ros-args', '-p', 'smoother:method:=magic'],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 2, done.stderr
    assert 'choose one of' in done.stderr
    assert not (tmp_path / 'hijacked').exists()


def test_progress_is_a_line_per_ten_seconds_in_a_pipe(monkeypatch, capsys):
    now = iter(range(100))
    monkeypatch.setattr(progress.time, 'monotonic', lambda: float(next(now)))
    with progress.progress('counting', 40) as tick:
        for _ in range(40):
            tick()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == 'counting: 10 of 40, 0:30 left'
    assert len(lines) == 4


def test_an_output_without_room_is_one_line(tmp_path):
    (tmp_path / 'file').touch()
    with (
        pytest.raises(outputs.OutputError, match='cannot be written'),
        outputs.written(tmp_path / 'file' / 'out.mcap', force=False),
    ):
        pass
    assert os.listdir(tmp_path) == ['file']
