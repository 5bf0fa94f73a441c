"""A second publisher is told; what the graph keeps of a killed one is not."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: E402

from binopos_ros.nodes.neighbours import LEASE, Neighbours  # noqa: E402
from binopos_ros.nodes.shell import LOOK_PERIOD  # noqa: E402

TOPIC = '/stereo/left/centroid'
DRIVER = """
import time
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
rclpy.init(args=[])
node = rclpy.create_node('driver', namespace='stereo')
publisher = node.create_publisher(PoseWithCovarianceStamped, 'left/centroid', 5)
while True:
    publisher.publish(PoseWithCovarianceStamped())
    time.sleep(0.05)
"""


@pytest.fixture
def drive(ros_domain: int) -> Iterator[Callable[[], subprocess.Popen[bytes]]]:
    """Start a driver of another's making that publishes centroids."""
    running = []

    def start() -> subprocess.Popen[bytes]:
        running.append(subprocess.Popen([sys.executable, '-c', DRIVER]))
        return running[-1]

    yield start
    for each in running:
        each.kill()
        each.wait()


@pytest.mark.live
def test_what_is_left_of_a_killed_publisher_is_no_second_one(start, peer, drive):
    diagnostics = peer.listen(DiagnosticArray, '/diagnostics')
    start('triangulator', parameters={'triangulator': {'method': 'straight'}})

    def publishers() -> set[bytes]:
        return {bytes(each.endpoint_gid) for each in peer.node.get_publishers_info_by_topic(TOPIC)}

    def told() -> list[DiagnosticStatus]:
        every = [status for array in diagnostics for status in array.status]
        return [each for each in every if each.name == 'stereo/triangulator: stage']

    def received() -> int:
        values = {item.key: item.value for each in told()[-1:] for item in each.values}
        return int(values.get('Received left/centroid', 0))

    killed = drive()
    peer.wait_for(lambda: received() > 10, 'centroids')
    old = publishers()
    killed.kill()
    killed.wait()
    drive()
    peer.wait_for(lambda: bool(publishers() - old), 'the driver that was started again')
    before, level = len(told()), received()
    # The killed one stands in the graph beside it for the rest of its lease.
    peer.wait_for(lambda: len(told()) >= before + 4 and received() > level + 10, 'diagnostics')
    assert not [each.message for each in told() if 'publishers' in each.message]
    drive()
    peer.wait_for(lambda: 'publishers' in told()[-1].message, 'a second living one')
    assert told()[-1].level == DiagnosticStatus.WARN
    assert f'{TOPIC} has 2 publishers: /stereo/driver and /stereo/driver' in told()[-1].message


def test_two_looks_take_less_than_a_second():
    """One that is seen in two looks is told."""
    assert 2 * LOOK_PERIOD < 1.0


HERE, THERE = b'\x01\x0f\x11\x11', b'\x01\x0f\x22\x22'
OWN = '/diagnostics'


def endpoint(name: str, machine: bytes, process: int, number: int = 0) -> SimpleNamespace:
    identity = machine + (process & 0xFFFF).to_bytes(2, 'little') + bytes([0, number]) + bytes(8)
    return SimpleNamespace(node_name=name, node_namespace='/stereo', endpoint_gid=identity)


class Graph:
    """What the middleware says of who publishes."""

    def __init__(self, *publishers: SimpleNamespace, own: bytes = HERE) -> None:
        self.publishers = list(publishers)
        self.own = endpoint('looker', own, os.getpid())

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        return [self.own] if topic == OWN else self.publishers

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [('looker', '/stereo')]

    def get_name(self) -> str:
        return 'looker'

    def get_namespace(self) -> str:
        return '/stereo'

    def get_fully_qualified_name(self) -> str:
        return '/stereo/looker'


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Its last item is the time."""
    now = [0.0]
    monkeypatch.setattr(time, 'monotonic', lambda: now[-1])
    return now


def told(neighbours: Neighbours) -> bool:
    return TOPIC in neighbours.intruders([TOPIC])


@pytest.fixture
def ended() -> int:
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, '-c', ''])
    process.wait()
    return process.pid


def look(graph: Any) -> Neighbours:
    return Neighbours(graph, OWN)


def test_a_process_of_this_machine_that_has_ended_is_no_publisher(clock, ended):
    graph = Graph(endpoint('a', HERE, ended), endpoint('b', HERE, os.getpid()))
    neighbours = look(graph)
    assert not told(neighbours)
    # DDS would have forgotten it by now: it lives where its process cannot be seen.
    clock.append(LEASE + 1.0)
    assert told(neighbours)


def test_a_process_that_nobody_has_waited_for_has_ended(clock):
    process = subprocess.Popen([sys.executable, '-c', ''])
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    graph = Graph(endpoint('a', HERE, process.pid), endpoint('b', HERE, os.getpid()))
    assert not told(look(graph))
    process.wait()


def test_two_living_publishers_are_told_whatever_their_names(clock):
    for name in ('a', 'b'):
        one, other = endpoint('a', HERE, os.getpid()), endpoint(name, HERE, os.getppid())
        assert told(look(Graph(one, other)))


@pytest.mark.parametrize('own', [HERE, b'\x01\x10\x11\x11'], ids=['machine', 'middleware'])
def test_where_processes_are_not_seen_names_and_the_lease_decide(clock, own):
    assert told(look(Graph(endpoint('a', THERE, 7), endpoint('b', THERE, 8), own=own)))
    again = Graph(endpoint('a', THERE, 7), endpoint('a', THERE, 8), own=own)
    neighbours = look(again)
    assert not told(neighbours)
    clock.append(LEASE - 1.0)
    assert not told(neighbours)
    # The killed one goes, and the next is started again: doubts begin anew.
    again.publishers = again.publishers[1:]
    assert not told(neighbours)
    again.publishers.append(endpoint('a', THERE, 9))
    clock.append(LEASE + 1.0)
    assert not told(neighbours)
    clock.append(2.0 * LEASE + 2.0)
    assert told(neighbours)
