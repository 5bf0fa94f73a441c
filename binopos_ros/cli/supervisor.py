"""Keeps the nodes up: each in a process of its own, restarted with growing pauses when it dies."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from binopos_ros.cli.transport import transport_environment
from binopos_ros.nodes.supervised import STARTER, SUPERVISED

FIRST_PAUSE = 0.5
LONGEST_PAUSE = 30.0
#: A node that stayed up for this long has recovered: its next pause is the first one again.
RECOVERED = 20.0
#: Seconds that a node has to end after SIGTERM.
PATIENCE = 4.0
USAGE_ERROR = 2


@dataclass
class Child:
    """One node's process and its history."""

    name: str
    command: list[str]
    process: subprocess.Popen[bytes] | None = None
    started: float = 0.0
    restart_at: float = 0.0
    pause: float = FIRST_PAUSE


@dataclass
class Supervisor:
    """Starts nodes, restarts those that die, ends them all.

    Args:
        nodes: the names of the nodes.
        ros_arguments: words that every node gets after `--ros-args`.
        single_process: compose all nodes in one process instead of one each.
        enclaves: path below which each process has its security enclave, under the name of its
            node; '' leaves enclaves to the words.
        report: takes one line of text for the user.
    """

    nodes: Sequence[str]
    ros_arguments: Sequence[str] = ()
    single_process: bool = False
    enclaves: str = ''
    report: Callable[[str], None] = field(default=lambda line: print(line, file=sys.stderr))

    def __post_init__(self) -> None:
        groups = [tuple(self.nodes)] if self.single_process else [(name,) for name in self.nodes]
        self.children = [
            Child(
                ' + '.join(names),
                [sys.executable, STARTER, *names, *self._ros_words(names)],
            )
            for names in groups
        ]

    def _ros_words(self, names: Sequence[str]) -> list[str]:
        words = [*self.ros_arguments, *enclave_words(self.enclaves, names)]
        return ['--ros-args', *words] if words else []

    def start(self) -> None:
        """Start every node."""
        for child in self.children:
            self._start(child)

    def poll(self) -> str:
        """Restart what has died; to be called a few times per second.

        Returns '' or, where a node refused its parameters, why the suite cannot run.
        """
        now = time.monotonic()
        for child in self.children:
            if child.process is None:
                if now >= child.restart_at:
                    self._start(child)
                continue
            status = child.process.poll()
            if status is None:
                continue
            if status == USAGE_ERROR:
                return f'the {child.name} refused to start (see its line above)'
            if now - child.started > RECOVERED:
                child.pause = FIRST_PAUSE
            self.report(
                f'the {child.name} died ({describe_exit(status)}): '
                f'starting it again in {child.pause:g} s'
            )
            child.process = None
            child.restart_at = now + child.pause
            child.pause = min(2 * child.pause, LONGEST_PAUSE)
        return ''

    def stop(self) -> None:
        """End every node: SIGTERM, then SIGKILL for those that do not listen.

        Not SIGINT: a Python that is still starting up answers it with a traceback.
        """
        for number in (signal.SIGTERM, signal.SIGKILL):
            running = [child for child in self.children if child.process is not None]
            for child in running:
                if child.process is not None and child.process.poll() is None:
                    if number == signal.SIGKILL:
                        self.report(f'the {child.name} did not end when asked: killed')
                    child.process.send_signal(number)
            deadline = time.monotonic() + PATIENCE
            for child in running:
                if child.process is None:
                    continue
                try:
                    child.process.wait(max(0.0, deadline - time.monotonic()))
                    child.process = None
                except subprocess.TimeoutExpired:
                    continue

    def _start(self, child: Child) -> None:
        child.started = time.monotonic()
        child.process = subprocess.Popen(
            child.command,
            # Ctrl-C in the terminal reaches the supervisor alone, which then ends them in order.
            start_new_session=True,
            env={**os.environ, **transport_environment(), SUPERVISED: '1'},
            stdin=subprocess.DEVNULL,
        )


def enclave_words(enclaves: str, names: Sequence[str]) -> list[str]:
    """The words that give a process its enclave: one per process, so that of its first node."""
    return ['--enclave', f'{enclaves.rstrip("/")}/{names[0]}'] if enclaves else []


def add_supervisor_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the verbs that start nodes."""
    parser.add_argument(
        '--single-process',
        action='store_true',
        help='compose all nodes in one process instead of one process each',
    )
    parser.add_argument(
        '--enclaves',
        default='',
        metavar='PATH',
        help='SROS2: give each node the enclave PATH/NODE; in one process, that of the first node',
    )


def describe_exit(status: int) -> str:
    """An exit status in words."""
    if status < 0:
        return f'killed by {signal.Signals(-status).name}'
    return f'exit status {status}'
