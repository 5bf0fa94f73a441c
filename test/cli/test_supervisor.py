"""`binopos run` keeps its nodes up, says why one died, and ends them all."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from binopos_ros.cli.supervisor import Supervisor
from binopos_ros.nodes.supervised import STARTER

pytest.importorskip('rclpy', reason='rclpy is not installed')

pytestmark = pytest.mark.live

PATIENCE = 20.0


class Suite:
    """`binopos run` as a user starts it, and its nodes as the system sees them."""

    def __init__(self, errors: Path, *words: str) -> None:
        self._errors = errors
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'binopos_ros', 'run', *words],
            stdout=subprocess.DEVNULL,
            stderr=errors.open('w'),
        )

    @property
    def errors(self) -> str:
        return self._errors.read_text()

    def nodes(self) -> dict[str, int]:
        """Process ids of the running nodes by name."""
        found = {}
        for entry in Path('/proc').iterdir():
            try:
                words = (entry / 'cmdline').read_bytes().decode().split('\0')
                parent = int((entry / 'stat').read_text().rpartition(')')[2].split()[1])
            except (OSError, ValueError):
                continue
            if STARTER in words and parent == self.process.pid:
                found[words[words.index(STARTER) + 1]] = int(entry.name)
        return found

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                pytest.fail(f'{what} did not happen; stderr: {self.errors}')
            time.sleep(0.02)

    def is_up(self, names: set[str]) -> bool:
        """Whether these nodes run, and as themselves: not still on their way into Python."""
        return set(self.nodes()) == names


@pytest.fixture
def suite(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., Suite]]:
    running: list[Suite] = []

    def start(*words: str) -> Suite:
        running.append(Suite(tmp_path / 'stderr', *words))
        return running[-1]

    yield start
    for each in running:
        each.process.kill()
        each.process.wait()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=['SIGINT', 'SIGTERM'])
def test_a_signal_ends_the_supervisor_and_every_node(suite, number):
    running = suite('--nodes', 'detector', 'smoother')
    running.wait_for(lambda: running.is_up({'detector', 'smoother'}), 'the start')
    pids = running.nodes().values()
    time.sleep(2.0)
    running.process.send_signal(number)
    assert running.process.wait(PATIENCE) == 0
    assert not any(Path(f'/proc/{pid}').exists() for pid in pids)
    assert running.errors == ''


def test_a_node_that_is_killed_is_started_again_and_the_reason_is_told(suite):
    running = suite('--nodes', 'detector', 'smoother')
    running.wait_for(lambda: running.is_up({'detector', 'smoother'}), 'the start')
    first = running.nodes()
    os.kill(first['smoother'], signal.SIGKILL)
    running.wait_for(
        lambda: running.nodes().get('smoother') not in (None, first['smoother']), 'the restart'
    )
    assert 'the smoother died (killed by SIGKILL): starting it again in 0.5 s' in running.errors
    second = running.nodes()
    assert second['detector'] == first['detector']
    os.kill(second['smoother'], signal.SIGKILL)
    running.wait_for(lambda: 'again in 1 s' in running.errors, 'the longer pause')


def test_a_node_that_refuses_its_parameters_ends_the_suite(suite):
    words = ('-p', 'triangulator:method:=straight', '-p', 'smoother:method:=magic')
    running = suite('--nodes', 'triangulator', 'smoother', '--ros-args', *words)
    assert running.process.wait(PATIENCE) == 2
    assert running.errors.startswith("binopos run: -p smoother:method:=magic: parameter 'method'")
    assert running.errors.count('\n') == 1


def test_a_node_that_cannot_start_on_this_machine_ends_the_suite(suite):
    """What the verb cannot know: how the node finds the middleware and the machine."""
    override = 'qos_overrides./stereo/left/centroid.publisher.reliability:=relaible'
    running = suite('--nodes', 'detector', '--ros-args', '-p', f'detector:{override}')
    assert running.process.wait(PATIENCE) == 2
    lines = running.errors.splitlines()
    assert lines[0].startswith('detector: qos_overrides./stereo/left/centroid cannot be used')
    assert 'relaible' in lines[0]
    assert lines[1].startswith('binopos run: the detector refused to start')


def test_a_supervisor_that_is_killed_leaves_no_node_behind(suite):
    running = suite('--nodes', 'smoother')
    running.wait_for(lambda: running.is_up({'smoother'}), 'the start')
    time.sleep(2.0)
    (pid,) = running.nodes().values()
    running.process.kill()
    running.wait_for(lambda: not Path(f'/proc/{pid}').exists(), 'the end of the node')


def test_single_process_composes_all_nodes_in_one(suite):
    running = suite('--nodes', 'detector', 'smoother', '--single-process')
    running.wait_for(lambda: running.is_up({'detector'}), 'the start')
    words = Path(f'/proc/{running.nodes()["detector"]}/cmdline').read_bytes().decode().split('\0')
    assert 'smoother' in words
    time.sleep(2.0)
    running.process.send_signal(signal.SIGINT)
    assert running.process.wait(PATIENCE) == 0


def test_each_process_has_the_enclave_of_its_node():
    nodes = ('detector', 'smoother')
    each = Supervisor(nodes, ['--log-level', 'warn'], enclaves='/binopos').children
    assert [child.command[-2:] for child in each] == [
        ['--enclave', '/binopos/detector'],
        ['--enclave', '/binopos/smoother'],
    ]
    (both,) = Supervisor(nodes, single_process=True, enclaves='/binopos').children
    assert both.command[-3:] == ['--ros-args', '--enclave', '/binopos/detector']
