"""`binopos report`: one page about a dive, to hand to a client."""

from __future__ import annotations

import argparse
from pathlib import Path

from binopos_ros.cli.config import add_config_argument, live_parameters
from binopos_ros.cli.outputs import add_force_argument, written
from binopos_ros.cli.provenance import how_made
from binopos_ros.view.dive import Dive
from binopos_ros.view.dive_page import dive_page
from binopos_ros.view.story import tell


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        'bags',
        nargs='+',
        type=Path,
        metavar='BAG',
        help='bags of one dive, such as what `binopos process` made and then the recording with '
        'its pictures; of a topic that several hold, the first counts',
    )
    parser.add_argument(
        '-o', '--output', required=True, type=Path, metavar='HTML', help='page to write'
    )
    add_force_argument(parser)
    add_config_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    """Write the page; 1 where the bags hold no pose, else 0."""
    live_parameters(arguments)
    with written(arguments.output, arguments.force) as part:
        with Dive(arguments.bags) as dive:
            story = tell(dive)
            dropped = dive.dropped
        made = how_made(arguments, *arguments.bags)
        if dropped:
            lost = f'{dropped} messages could not be read'
            made = made._replace(inputs=[*made.inputs, lost])
        part.write_text(dive_page(story, made), encoding='utf-8')
    print(f'{arguments.output}: {len(story.stamps)} poses, {len(story.events)} events')
    return 0 if len(story.stamps) else 1
