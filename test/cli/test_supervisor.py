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

PATIENCE = 60.0


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
        """What it has said, without what its nodes merely log."""
        lines = self._errors.read_text().splitlines(keepends=True)
        return ''.join(line for line in lines if not line.startswith('[INFO]'))

    def nodes(self) -> dict[str, int]:
        """Process ids of the running nodes by name."""
        found = {}
        for entry in Path('/proc').iterdir():
            try:
                words = (entry / 'cmdline').read_bytes().decode().split('\0')
                comm = (entry / 'comm').read_text().strip()
                parent = int((entry / 'stat').read_text().rpartition(')')[2].split()[1])
            except (OSError, ValueError):
                continue
            if STARTER in words and parent == self.process.pid:
                name = words[words.index(STARTER) + 1]
                # A spare bears the name of the node that it has become.
                found[comm if name == '--spare' else name] = int(entry.name)
        return {name: pid for name, pid in found.items() if not name.startswith('python')}

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                pytest.fail(f'{what} did not happen; stderr: {self.errors}')
            time.sleep(0.02)

    def is_answering(self, pid: int) -> bool:
        """Whether a process has begun to run its node, whose name it bears from then on."""
        comm = Path(f'/proc/{pid}/comm').read_text().strip()
        return not comm.startswith('python')

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


def test_a_node_that_hangs_is_killed_and_started_again(suite):
    running = suite('--nodes', 'detector', 'smoother')
    running.wait_for(lambda: running.is_up({'detector', 'smoother'}), 'the start')
    first = running.nodes()
    running.wait_for(lambda: running.is_answering(first['smoother']), 'its first turn')
    os.kill(first['smoother'], signal.SIGSTOP)
    running.wait_for(
        lambda: running.nodes().get('smoother') not in (None, first['smoother']), 'the restart'
    )
    lines = running.errors.splitlines()
    assert lines[0].startswith('the smoother has not answered for ')
    assert lines[0].endswith(' s: it is stopped: killing it')
    assert lines[1].startswith('the smoother died (killed by SIGKILL): starting it again')
    assert running.nodes()['detector'] == first['detector']


def test_a_spare_takes_the_place_of_a_node_that_was_up_for_long(ros_domain):
    """Its process is there already; what it runs is told to it then."""
    told: list[str] = []
    supervisor = Supervisor(['smoother'], report=told.append)
    (child,) = supervisor.children
    supervisor.start()
    try:
        poll_until(supervisor, lambda: supervisor.spare is not None, 'a spare')
        spare = supervisor.spare
        child.started -= 3600.0
        child.process.kill()
        poll_until(supervisor, lambda: child.process is not None and bool(told), 'the restart')
        assert told == ['the smoother died (killed by SIGKILL): starting it again at once']
        assert child.process.pid == spare
        name = Path(f'/proc/{spare}/comm')
        poll_until(supervisor, lambda: name.read_text().strip() == 'smoother', 'the node')
    finally:
        supervisor.stop()
    assert not name.exists()


def poll_until(supervisor: Supervisor, condition: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert supervisor.poll() == ''
        if time.monotonic() > deadline:
            pytest.fail(f'{what} did not come')
        time.sleep(0.02)


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


@pytest.mark.parametrize('late', [0.0, 0.02, 0.05, 0.1, 0.3])
def test_nor_does_one_that_is_killed_while_a_node_starts(ros_domain, late):
    """Then no signal tells the node of it; the fixture sees to it that none stays."""
    starting = (
        'import os, time; from binopos_ros.cli.supervisor import Supervisor;'
        f'Supervisor(["smoother"]).start(); time.sleep({late}); os._exit(1)'
    )
    assert subprocess.run([sys.executable, '-c', starting], check=False).returncode == 1


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
    assert [child.words[-2:] for child in each] == [
        ['--enclave', '/binopos/detector'],
        ['--enclave', '/binopos/smoother'],
    ]
    (both,) = Supervisor(nodes, single_process=True, enclaves='/binopos').children
    assert both.words[-3:] == ['--ros-args', '--enclave', '/binopos/detector']


@pytest.mark.parametrize('kilobytes', [64, 600])
def test_nodes_do_without_shared_memory_where_it_is_full_and_say_so(
    ros_domain, tmp_path, kilobytes
):
    """In a namespace of its own, where /dev/shm is as small as that."""
    small = f'mount -t tmpfs -o size={kilobytes}k tmpfs /dev/shm'
    if subprocess.run(
        ['unshare', '-m', 'sh', '-c', small], check=False, capture_output=True
    ).returncode:
        pytest.skip('needs root: /dev/shm cannot be replaced')
    path = tmp_path / 'stderr'
    node = f'exec {sys.executable} {STARTER} smoother'
    with path.open('w') as errors:
        process = subprocess.Popen(
            ['unshare', '-m', 'sh', '-c', f'{small} && {node}'], stderr=errors
        )
    try:
        comm = Path(f'/proc/{process.pid}/comm')
        deadline = time.monotonic() + PATIENCE
        while comm.read_text().strip() != 'smoother':
            assert process.poll() is None, path.read_text()
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
    assert path.read_text().startswith('/dev/shm is full (0.')
    assert path.read_text().count('\n') == 1
