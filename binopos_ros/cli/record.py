"""`binopos record`: the suite's topics into a bag."""

from __future__ import annotations

import argparse

from binopos_ros.bag.recording import RecorderOptions
from binopos_ros.cli.config import add_config_argument, layers, live_parameters, ros_words
from binopos_ros.nodes.ros import require_ros

HELP = "record the suite's topics to a bag"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments, named as in `ros2 bag record`."""
    parser.description = (
        "Record the suite's topics under /stereo and /diagnostics until Ctrl-C. The bag is whole "
        'on the disk twice per second, so that it survives whatever ends the recorder.'
    )
    parser.add_argument(
        '-o',
        '--output',
        required=True,
        metavar='BAG',
        help='bag to make: a new folder, or a new file that ends in .mcap',
    )
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument('-a', '--all', action='store_true', help='record every topic there is')
    chosen.add_argument(
        '--topics', nargs='+', metavar='TOPIC', help="record these instead of the suite's"
    )
    parser.add_argument(
        '--compression',
        choices=('none', 'zstd', 'lz4'),
        help="of the bag's chunks; JPEG images hardly shrink (default: none)",
    )
    parser.add_argument(
        '-b',
        '--max-bag-size',
        type=int,
        metavar='BYTES',
        help=f'begin a new file beyond this, 0: never (default: {RecorderOptions.max_bag_size})',
    )
    parser.add_argument(
        '-d',
        '--max-bag-duration',
        type=float,
        metavar='SECONDS',
        help='begin a new file after this, 0: never '
        f'(default: {RecorderOptions.max_bag_duration:g})',
    )
    add_config_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Record until told to stop; the exit status."""
    require_ros()
    from rclpy.parameter import Parameter

    from binopos_ros.nodes.recorder import record

    live_parameters(arguments).of_node('recorder')
    given = {
        'bag': arguments.output,
        'all': arguments.all or None,
        'topics': arguments.topics,
        'compression': arguments.compression,
        'max_bag_size': arguments.max_bag_size,
        'max_bag_duration': arguments.max_bag_duration,
    }
    typed = [Parameter(name, value=value) for name, value in given.items() if value is not None]
    return record(ros_words(layers(arguments), arguments.ros_arguments), typed)
