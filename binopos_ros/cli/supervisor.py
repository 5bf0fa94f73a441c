"""Keeps the nodes up: each in a process of its own, restarted when it dies or hangs.

A node that has run for a while and dies is started again at once, in a spare process that has all
imports behind it; pauses grow where it dies again and again.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from binopos_ros.capture.transport import TRANSPORTS_VARIABLE, full_memory_notice
from binopos_ros.cli import USAGE_ERROR
from binopos_ros.cli.pulse import Pulse
from binopos_ros.cli.transport import transport_environment
from binopos_ros.nodes.supervised import HEARTBEAT, STARTER, SUPERVISED
from binopos_ros.view.access import TOKEN_VARIABLE, new_token

FIRST_PAUSE = 0.5
LONGEST_PAUSE = 30.0
#: A node that stayed up for this long has recovered: its next pause is the first one again.
RECOVERED = 20.0
#: Seconds that all nodes have been up for when a spare is started.
SETTLED = 5.0
#: Seconds that a node has to end after SIGTERM.
PATIENCE = 4.0


@dataclass
class Child:
    """One node's process and its history; `words` are those of its starter."""

    name: str
    words: list[str]
    process: subprocess.Popen[bytes] | None = None
    pulse: Pulse | None = None
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
            Child(' + '.join(names), [*names, *self._ros_words(names)]) for names in groups
        ]
        self._spare: tuple[subprocess.Popen[bytes], Pulse] | None = None

    def _ros_words(self, names: Sequence[str]) -> list[str]:
        words = [*self.ros_arguments, *enclave_words(self.enclaves, names)]
        return ['--ros-args', *words] if words else []

    @property
    def spare(self) -> int | None:
        """Process id of the spare, where one is kept."""
        return None if self._spare is None else self._spare[0].pid

    def start(self) -> None:
        """Start every node."""
        if TRANSPORTS_VARIABLE in transport_environment():
            self.report(full_memory_notice())
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
                if child.pulse is not None and (trouble := child.pulse.trouble(now)):
                    self.report(f'the {child.name} {trouble}: killing it')
                    child.process.kill()
                    child.process.wait()
                continue
            if status == USAGE_ERROR:
                return f'the {child.name} refused to start (see its line above)'
            pause = 0.0 if now - child.started > RECOVERED else child.pause
            child.pause = min(2 * pause, LONGEST_PAUSE) if pause else FIRST_PAUSE
            when = f'in {pause:g} s' if pause else 'at once'
            why = describe_exit(status)
            if status == -signal.SIGBUS and TRANSPORTS_VARIABLE in transport_environment():
                # A spare has been told of another transport.
                self._end_spare()
                why = full_memory_notice()
            self.report(f'the {child.name} died ({why}): starting it again {when}')
            self._forget(child)
            child.restart_at = now + pause
            if not pause:
                self._start(child)
        self._keep_spare(now)
        return ''

    def stop(self) -> None:
        """End every node: SIGTERM, then SIGKILL for those that do not listen.

        Not SIGINT: a Python that is still starting up answers it with a traceback.
        """
        self._end_spare()
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
                    self._forget(child)
                except subprocess.TimeoutExpired:
                    continue

    def _start(self, child: Child) -> None:
        child.started = time.monotonic()
        spare, self._spare = self._spare, None
        if spare is None or not _tell(spare[0], child.words):
            spare = _started(child.words, subprocess.DEVNULL)
        child.process, child.pulse = spare

    def _keep_spare(self, now: float) -> None:
        """Start a spare once all nodes have settled, so that it takes nothing from their start."""
        if self._spare is not None and self._spare[0].poll() is not None:
            self._spare[1].close()
            self._spare = None
        settled = all(
            child.pulse is not None and child.pulse.is_up and now - child.started > SETTLED
            for child in self.children
        )
        if self._spare is None and settled:
            self._spare = _started(['--spare'], subprocess.PIPE)

    def _end_spare(self) -> None:
        if self._spare is not None:
            process, pulse = self._spare
            process.kill()
            process.wait()
            pulse.close()
            self._spare = None

    def _forget(self, child: Child) -> None:
        child.process = None
        if child.pulse is not None:
            child.pulse.close()
            child.pulse = None


def _started(words: Sequence[str], stdin: int) -> tuple[subprocess.Popen[bytes], Pulse]:
    """A process of the starter, and its pulse."""
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    os.set_blocking(writing, False)
    environment = {**os.environ, **transport_environment()}
    environment |= {SUPERVISED: str(os.getpid()), HEARTBEAT: str(writing)}
    process = subprocess.Popen(
        [sys.executable, STARTER, *words],
        # Ctrl-C in the terminal reaches the supervisor alone, which then ends them in order.
        start_new_session=True,
        env=environment,
        stdin=stdin,
        pass_fds=[writing],
    )
    os.close(writing)
    return process, Pulse(reading, process.pid)


def _tell(spare: subprocess.Popen[bytes], words: Sequence[str]) -> bool:
    """Let a spare run the nodes that the words name; whether it heard."""
    assert spare.stdin is not None
    try:
        spare.stdin.write(json.dumps(list(words)).encode() + b'\n')
        spare.stdin.close()
    except OSError:
        return False
    return spare.poll() is None


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
        '--view',
        action='store_true',
        help="serve the operator's page as well, as `binopos view` does (the node viewer)",
    )
    parser.add_argument(
        '--enclaves',
        default='',
        metavar='PATH',
        help='SROS2: give each node the enclave PATH/NODE; in one process, that of the first node',
    )


def viewer_of(arguments: argparse.Namespace) -> list[str]:
    """The node that serves the page, where it is asked for; its token outlives it."""
    if not arguments.view:
        return []
    os.environ.setdefault(TOKEN_VARIABLE, new_token())
    return ['viewer']


def describe_exit(status: int) -> str:
    """An exit status in words."""
    if status < 0:
        return f'killed by {signal.Signals(-status).name}'
    return f'exit status {status}'
