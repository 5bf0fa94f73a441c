"""Nodes as processes of their own, and a ROS node in the test to talk to them."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from binopos_ros.nodes.supervised import STARTER

rclpy = pytest.importorskip('rclpy', reason='rclpy is not installed')

PATIENCE = 20.0
#: What the tests publish, each message once: best effort may lose one on a busy machine.
RELIABLE = [
    *(
        f'/stereo/{side}/{name}'
        for side in ('left', 'right')
        for name in ('image_raw', 'image_raw/compressed', 'camera_info', 'centroid')
    ),
    '/stereo/target/position',
    '/stereo/platform/odometry',
]


class NodeProcess:
    """One or more nodes of the suite in a process, as `ros2 run` starts them."""

    def __init__(
        self, folder: Path, names: tuple[str, ...], parameters: dict[str, Any], reliable: bool
    ) -> None:
        path = folder / f'{"_".join(names)}.yaml'
        overrides = {topic: {'subscription': {'reliability': 'reliable'}} for topic in RELIABLE}
        every: dict[str, Any] = {'robot_name': 'auv7'}
        if reliable:
            every['qos_overrides'] = overrides
        blocks = {'/**': {'ros__parameters': every}} | {
            f'/**/{name}': {'ros__parameters': values} for name, values in parameters.items()
        }
        path.write_text(yaml.safe_dump(blocks), encoding='utf-8')
        self.process = subprocess.Popen(
            [
                *(sys.executable, STARTER, *names),
                *('--ros-args', '--params-file', str(path)),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """Send a signal and wait for the end; exit status and stderr."""
        self.process.send_signal(number)
        return self.wait()

    def wait(self, seconds: float = PATIENCE) -> tuple[int, str]:
        """Wait for the process; exit status and stderr, without what decodes JPEGs here."""
        _, errors = self.process.communicate(timeout=seconds)
        lines = errors.splitlines(keepends=True)
        return self.process.returncode, ''.join(
            x for x in lines if 'JPEGs are decoded by' not in x
        )


class Peer:
    """The test's own node in the namespace /stereo."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('test_peer', namespace='stereo', context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.got: dict[str, list[Any]] = {}

    def publisher(self, message_type: type, topic: str) -> Any:
        return self.node.create_publisher(message_type, topic, 50)

    def listen(self, message_type: type, topic: str) -> list[Any]:
        self.got[topic] = []
        self.node.create_subscription(message_type, topic, self.got[topic].append, 50)
        return self.got[topic]

    def wait_for(
        self, condition: Callable[[], bool], what: str, seconds: float = PATIENCE
    ) -> None:
        """Spin until a condition holds; fail with its name where it does not in time."""
        deadline = time.monotonic() + seconds
        while not condition():
            self.executor.spin_once(timeout_sec=0.02)
            if time.monotonic() > deadline:
                pytest.fail(f'{what} did not come within {seconds:g} s')

    def connect(self, *publishers: Any, inputs: tuple[str, ...] = ()) -> None:
        """Wait until somebody listens to the publishers and somebody sends the inputs."""
        names = [f'/stereo/{name}' for name in inputs]
        self.wait_for(
            lambda: (
                all(each.get_subscription_count() for each in publishers)
                and all(self.node.count_publishers(name) for name in names)
            ),
            'the connection to the nodes',
        )
        # Both ends must know each other before best effort is kept.
        settled = time.monotonic() + 0.5
        self.wait_for(lambda: time.monotonic() > settled, 'half a second')

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def start(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start nodes: start('triangulator', 'smoother', parameters={'smoother': {...}})."""
    running: list[NodeProcess] = []

    def starter(
        *names: str, parameters: dict[str, Any] | None = None, reliable: bool = True
    ) -> NodeProcess:
        running.append(NodeProcess(tmp_path, names, parameters or {}, reliable))
        return running[-1]

    yield starter
    for each in running:
        if each.process.poll() is None:
            each.process.kill()
            each.process.communicate()


@pytest.fixture
def peer(ros_domain: int) -> Iterator[Peer]:
    """A ROS node of the test's own."""
    node = Peer()
    yield node
    node.close()
