"""`binopos run`: the live nodes on the cameras of the rig, kept up."""

from __future__ import annotations

import argparse
import signal
import sys
import time

from binopos_ros.cli.config import add_config_argument, layers, live_parameters, ros_words
from binopos_ros.cli.supervisor import Supervisor, add_supervisor_arguments, viewer_of
from binopos_ros.node_options import LIVE
from binopos_ros.nodes.ros import require_ros

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
    supervisor = Supervisor(nodes, words, arguments.single_process, arguments.enclaves)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        supervisor.start()
        while not (problem := supervisor.poll()):
            time.sleep(POLL)
        print(f'binopos run: {problem}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 0
    finally:
        supervisor.stop()
