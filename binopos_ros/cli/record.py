"""`binopos record`: the suite's topics into a bag."""

from __future__ import annotations

import argparse

from binopos_ros.bag.recording import RecorderOptions
from binopos_ros.cli.config import add_config_argument, layers, live_parameters, ros_words
from binopos_ros.nodes.ros import require_ros


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
    chosen.add_argument(
        '-e', '--regex', metavar='REGEX', help='record topics whose names this is found in instead'
    )
    parser.add_argument(
        '-x',
        '--exclude-regex',
        metavar='REGEX',
        help='leave out topics whose names this is found in',
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
    parser.add_argument(
        '--start-paused',
        action='store_true',
        help='record nothing before the service recorder/resume is called',
    )
    parser.add_argument(
        '--snapshot',
        type=float,
        metavar='SECONDS',
        help='keep the last SECONDS in memory, and write them whenever the service '
        'recorder/snapshot is called',
    )
    parser.add_argument(
        '--min-free-space',
        type=int,
        metavar='BYTES',
        help='end when less is left on the disk, 0: never '
        f'(default: {RecorderOptions.min_free_space})',
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
        'regex': arguments.regex,
        'exclude_regex': arguments.exclude_regex,
        'start_paused': arguments.start_paused or None,
        'snapshot': arguments.snapshot,
        'min_free_space': arguments.min_free_space,
        'compression': arguments.compression,
        'max_bag_size': arguments.max_bag_size,
        'max_bag_duration': arguments.max_bag_duration,
    }
    typed = [Parameter(name, value=value) for name, value in given.items() if value is not None]
    return record(ros_words(layers(arguments), arguments.ros_arguments), typed)
