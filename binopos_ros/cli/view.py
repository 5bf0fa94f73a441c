"""`binopos view`: the operator's page on the live topics, in a browser."""

from __future__ import annotations

import argparse

from binopos_ros.cli.config import add_config_argument, layers, live_parameters, ros_words
from binopos_ros.nodes.ros import require_ros
from binopos_ros.view.options import ViewerOptions

HELP = "serve the operator's page: what the rig sees and what is wrong, in a browser"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        '--listen',
        metavar='ADDRESS',
        help='address to serve on, 0.0.0.0 for all; others than this machine then need the token '
        f'that is printed (default: {ViewerOptions.listen})',
    )
    parser.add_argument(
        '--port', type=int, help=f'port to serve on, 0: any (default: {ViewerOptions.port})'
    )
    parser.add_argument(
        '--no-buttons', action='store_true', help='only show: viewers cannot press buttons'
    )
    add_config_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Serve until told to stop; the exit status."""
    require_ros()
    from rclpy.parameter import Parameter

    from binopos_ros.nodes.viewer import view

    live_parameters(arguments).check('viewer')
    given = {
        'listen': arguments.listen,
        'port': arguments.port,
        'buttons': False if arguments.no_buttons else None,
    }
    typed = [Parameter(name, value=value) for name, value in given.items() if value is not None]
    return view(ros_words(layers(arguments), arguments.ros_arguments), typed)
