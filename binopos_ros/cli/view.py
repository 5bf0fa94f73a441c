"""`binopos view`: the operator's page in a browser, on the live topics or on a dive's bags."""

from __future__ import annotations

import argparse
import signal
from dataclasses import replace
from pathlib import Path

from binopos_ros.cli.config import add_config_argument, layers, live_parameters, ros_words
from binopos_ros.nodes.ros import require_ros
from binopos_ros.parameters import build
from binopos_ros.view.options import ViewerOptions


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'bags',
        nargs='*',
        type=Path,
        metavar='BAG',
        help="show a dive's bags instead of the live topics, such as what `binopos process` made "
        'and then the recording with its pictures; of a topic that several hold, the first counts',
    )
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
    given = {
        'listen': arguments.listen,
        'port': arguments.port,
        'buttons': False if arguments.no_buttons else None,
    }
    typed = {name: value for name, value in given.items() if value is not None}
    parameters = live_parameters(arguments)
    options = build(ViewerOptions, parameters.of_node('viewer') | typed)
    if arguments.bags:
        return _view_bags(arguments.bags, replace(options, buttons=False))
    require_ros()
    from rclpy.parameter import Parameter

    from binopos_ros.nodes.viewer import view

    return view(
        ros_words(layers(arguments), arguments.ros_arguments),
        [Parameter(name, value=value) for name, value in typed.items()],
    )


def _view_bags(bags: list[Path], options: ViewerOptions) -> int:
    from binopos_ros.view.dive import Dive
    from binopos_ros.view.recorded import BagPage

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with Dive(bags) as dive:
        page = BagPage(dive, options)
        try:
            print(f'the page is served at {page.address}', flush=True)
            page.run()
        except KeyboardInterrupt:
            pass
        finally:
            page.close()
    return 0
