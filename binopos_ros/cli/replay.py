"""`binopos replay`: a bag through the live nodes, as it happened, with a report at the end."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

from binopos_ros.bag import BagReader
from binopos_ros.bag.platform_topics import with_platform
from binopos_ros.bag.playback import PlayerOptions
from binopos_ros.bag.qos import played_as
from binopos_ros.bag.rig_topics import NAMESPACE
from binopos_ros.cli.config import (
    add_calibration_argument,
    add_config_argument,
    layers,
    live_parameters,
    ros_words,
    told_sources,
)
from binopos_ros.cli.installation import DEMO_BAG, needed
from binopos_ros.cli.rig_bag import RigBag
from binopos_ros.cli.stereo_topics import add_remap_argument, add_topic_arguments, rig_of
from binopos_ros.cli.supervisor import (
    Supervisor,
    add_supervisor_arguments,
    enclave_words,
    viewer_of,
)
from binopos_ros.cli.terminal import fitted
from binopos_ros.cli.transport import transport_environment
from binopos_ros.node_options import STAGES, Parameters
from binopos_ros.nodes.ros import require_ros
from binopos_ros.parameters import QOS_OVERRIDES, build
from binopos_ros.pipeline import make_platform
from binopos_ros.report import Fates, Report
from binopos_ros.sides import SIDES
from binopos_ros.smoothing.parts import PARTS

#: Kinds of topics that tell how the robot moves; what never moves is latched, and never lost.
MOVING = ('odometry', 'transforms')
#: Rate of /clock, Hz, as in `ros2 bag play`.
DEFAULT_CLOCK = 40.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments; those of the player are named as in `ros2 bag play`."""
    played = parser.add_mutually_exclusive_group(required=True)
    played.add_argument('bag', type=Path, nargs='?', metavar='BAG', help='bag of a stereo rig')
    played.add_argument(
        '--demo', action='store_true', help='play the bag that comes with the package'
    )
    add_config_argument(parser)
    add_calibration_argument(parser)
    add_supervisor_arguments(parser)
    parser.add_argument('-r', '--rate', type=float, metavar='RATE', help='speed; 1 is real time')
    parser.add_argument('-l', '--loop', action='store_true', help='begin again at the end')
    parser.add_argument(
        '--start-offset',
        type=float,
        metavar='SECONDS',
        help='begin this long after the start of the bag',
    )
    parser.add_argument(
        '--topics',
        nargs='+',
        default=(),
        metavar='TOPIC',
        help="topics to play; default: the rig's images and calibrations, and the truth",
    )
    add_topic_arguments(parser)
    add_remap_argument(parser)
    parser.add_argument(
        '--clock',
        type=float,
        nargs='?',
        const=DEFAULT_CLOCK,
        metavar='HZ',
        help="publish the bag's time on /clock, and let the nodes use it; done by itself where "
        'use_sim_time or output_rate want it',
    )
    parser.add_argument(
        '-p',
        '--start-paused',
        action='store_true',
        help='wait for the service player/resume',
    )
    parser.add_argument(
        '--wait-for-all-acked',
        type=int,
        metavar='MS',
        help='work on every pair, however late, and at the end wait this long for '
        'acknowledgements; 0: for ever, -1: not at all',
    )


def main(arguments: argparse.Namespace) -> int:
    """Run the verb; the exit status."""
    require_ros()
    from binopos_ros.cli.live_replay import Replay

    if arguments.demo:
        arguments.bag = needed(DEMO_BAG)
    with BagReader(arguments.bag) as reader:
        found, calibration = rig_of(reader, arguments)
        namespace = found.namespace or '/'
        parameters = live_parameters(arguments, arguments.bag, namespace)
        nodes = [*STAGES, *viewer_of(arguments)]
        for name in nodes:
            parameters.check(name)
        platform = make_platform(parameters.of_node('smoother'))
        found = with_platform(found, reader, platform.source, arguments.remap)
        bag = RigBag(reader, found, arguments.remap)
        clock = _clock(arguments, parameters)
        words = ['-p', 'use_sim_time:=true'] if clock else []
        if arguments.wait_for_all_acked is not None and arguments.wait_for_all_acked >= 0:
            words += ['-p', 'detector:newest_first:=false', *_lossless(found.namespace, bag)]
        if namespace != NAMESPACE:
            words += ['-r', f'__ns:={namespace}']
        supervisor = Supervisor(
            nodes,
            ros_words(layers(arguments, arguments.bag), [*words, *arguments.ros_arguments]),
            arguments.single_process,
            arguments.enclaves,
        )
        os.environ.update(transport_environment())
        report = Report(
            parameters=told_sources(arguments, parameters),
            fates=Fates.within(parameters.of_node('triangulator').get('pair_tolerance')),
            fixed_frame=platform.options.fixed_frame,
        )
        options = _player_options(arguments, parameters, bag, clock)
        replay = Replay(bag, options, parameters, calibration, report)
        problem = replay.run(supervisor, enclave_words(arguments.enclaves, ['player']))
    if problem:
        print(f'binopos replay: {problem}', file=sys.stderr)
        return 2
    report.interrupted = replay.interrupted
    print(fitted(report))
    if replay.interrupted:
        return 130
    return 0 if report.filtered.stamps else 1


def _lossless(namespace: str, bag: RigBag) -> list[str]:
    """Words by which the nodes ask for every message where it is offered so."""
    offered = {
        topic: role for topic, role in bag.rig.roles.items() if played_as(bag.topics[topic].qos)[0]
    }
    heard = {
        'detector': [topic for topic, role in offered.items() if role.is_image],
        'triangulator': [f'{namespace}/{side}/centroid' for side in SIDES],
        'smoother': [
            *(topic for topic, role in offered.items() if role.kind in MOVING),
            *(f'{namespace}/target/{part}' for part in ('position', *PARTS)),
        ],
    }
    return [
        word
        for node, topics in heard.items()
        for topic in topics
        for policy in ('reliability:=reliable', 'history:=keep_all')
        for word in ('-p', f'{node}:{QOS_OVERRIDES}{topic}.subscription.{policy}')
    ]


def _clock(arguments: argparse.Namespace, parameters: Parameters) -> float:
    """Rate of /clock: what was asked for, or what the nodes want, whose time is the bag's."""
    if arguments.clock is not None:
        return float(arguments.clock)
    rate = parameters.of_node('smoother').get('output_rate') or 0.0
    wanted = any(parameters.given(name).get('use_sim_time') for name in STAGES)
    # A timer fires with the first tick after it is due.
    return max(DEFAULT_CLOCK, 2 * rate) if wanted or rate > 0 else 0.0


def _player_options(
    arguments: argparse.Namespace, parameters: Parameters, bag: RigBag, clock: float
) -> PlayerOptions:
    """The player's parameters, under what was given on the command line."""
    typed = {
        'rate': arguments.rate,
        'loop': arguments.loop or None,
        'start_offset': arguments.start_offset,
        'topics': tuple(map(bag.name_of, arguments.topics)) or None,
        'start_paused': arguments.start_paused or None,
        'wait_for_all_acked': arguments.wait_for_all_acked,
    }
    values = {'topics': tuple(bag.rig.roles), **parameters.of_node('player')}
    values |= {name: value for name, value in typed.items() if value is not None}
    options: PlayerOptions = build(
        PlayerOptions, values | {'bag': str(arguments.bag), 'clock': clock}
    )
    return options
