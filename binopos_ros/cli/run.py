"""`binopos run`: the live nodes on the cameras of the rig, kept up."""

from __future__ import annotations

import argparse
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from binopos_ros.cli.config import add_config_argument, layers, live_parameters, ros_words
from binopos_ros.cli.status_line import StatusLine
from binopos_ros.cli.supervisor import (
    Supervisor,
    add_supervisor_arguments,
    enclave_words,
    viewer_of,
)
from binopos_ros.node_options import LIVE
from binopos_ros.nodes.ros import require_ros

if TYPE_CHECKING:
    from binopos_ros.nodes.status import StatusThread

POLL = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_config_argument(parser)
    add_supervisor_arguments(parser)
    parser.add_argument(
        '--nodes',
        nargs='+',
        choices=LIVE,
        default=LIVE,
        metavar='NODE',
        help=f'run only these of {", ".join(LIVE)}, beside a camera driver of your own for one',
    )


def main(arguments: argparse.Namespace) -> int:
    """Run the verb until it is told to stop; the exit status."""
    require_ros()
    parameters = live_parameters(arguments)
    nodes = [*arguments.nodes, *viewer_of(arguments)]
    for name in nodes:
        parameters.check(name)
    words = ros_words(layers(arguments), arguments.ros_arguments)
    line = StatusLine()
    supervisor = Supervisor(
        nodes, words, arguments.single_process, arguments.enclaves, line.report
    )
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        supervisor.start()
        with _status([*words, *enclave_words(arguments.enclaves, ['status'])], line) as status:
            while not (problem := supervisor.poll()):
                line.show(status.text)
                time.sleep(POLL)
        line.report(f'binopos run: {problem}')
        return 2
    except KeyboardInterrupt:
        return 0
    finally:
        line.end()
        supervisor.stop()


@contextmanager
def _status(words: list[str], line: StatusLine) -> Iterator[StatusThread]:
    from binopos_ros.nodes.status import StatusThread

    status = StatusThread(words)
    if status.problem:
        line.report(status.problem)
    try:
        yield status
    finally:
        status.close()
