"""A recording that is begun and ended on the page: the recorder, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

from rclpy.node import Node

from binopos_ros.nodes.supervised import HEARTBEAT, STARTER, SUPERVISED

RECORDER = 'recorder'
#: Seconds that the recorder has to finish its bag when the page's node ends.
PATIENCE = 4.0


class Recordings:
    """Starts a recorder beside a node, and ends it.

    Args:
        node: in whose namespace is recorded.
        folder: where the bags go, named by the time when they were begun.
    """

    def __init__(self, node: Node, folder: Path) -> None:
        self._node = node
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._bag = folder

    def start(self) -> tuple[bool, str]:
        """Begin a recording; whether that was done, and where to or why not."""
        namespace = self._node.get_namespace()
        is_there = (RECORDER, namespace) in self._node.get_node_names_and_namespaces()
        if self._runs or is_there:
            return False, 'a recorder runs already: stop it first'
        self._bag = self._folder / time.strftime('dive_%Y%m%d_%H%M%S')
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            words = ('-r', f'__ns:={namespace}', '-p', f'{RECORDER}:bag:={self._bag}')
            self._process = subprocess.Popen(
                [sys.executable, STARTER, RECORDER, '--ros-args', *words],
                # It ends with this process, and beats for nobody.
                env={**os.environ, SUPERVISED: str(os.getpid()), HEARTBEAT: ''},
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            return False, f'{self._bag}: {error.strerror or error}'
        return True, f'recording to {self._bag}'

    def stop(self) -> tuple[bool, str]:
        """End the recording; whether one ran."""
        if not self._runs:
            return False, 'no recording was begun here'
        assert self._process is not None
        self._process.terminate()
        return True, f'{self._bag} is recorded'

    def close(self) -> None:
        """End the recording and wait for its bag."""
        if self._process is not None:
            self._process.terminate()
            try:
                self._process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    @property
    def _runs(self) -> bool:
        return self._process is not None and self._process.poll() is None
