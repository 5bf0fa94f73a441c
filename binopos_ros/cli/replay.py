"""`binopos replay`: a bag through the live nodes, as it happened, with a report at the end."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from pathlib import Path

import rclpy
from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from binopos_ros.bag import BagReader
from binopos_ros.bag.playback import PlayerOptions
from binopos_ros.cli.config import NAMESPACE, add_config_argument, config_of_bag
from binopos_ros.cli.status_line import StatusLine
from binopos_ros.cli.stereo_topics import StereoTopics
from binopos_ros.cli.supervisor import Supervisor, add_supervisor_arguments
from binopos_ros.cli.transport import transport_environment
from binopos_ros.nodes.monitor import Monitor
from binopos_ros.nodes.player import Player
from binopos_ros.nodes.shell import stop_on_signals
from binopos_ros.parameters import build
from binopos_ros.report import Report

HELP = 'play a bag through the live nodes and report what comes out'

NODES = ('detector', 'triangulator', 'smoother')
INTERRUPTED = 130
#: Seconds for the nodes to come up and find each other.
START = 30.0
#: Seconds for their connections to settle once all of them are seen.
SETTLE = 0.5
#: Silence, in seconds, after which nothing more is expected; diagnostics come at 1 Hz.
DRAIN = 1.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments; those of the player are named as in `ros2 bag play`."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='bag of a stereo rig')
    add_config_argument(parser)
    add_supervisor_arguments(parser)
    parser.add_argument(
        '-r', '--rate', type=float, default=1.0, metavar='RATE', help='speed; 1 is real time'
    )
    parser.add_argument('-l', '--loop', action='store_true', help='begin again at the end')
    parser.add_argument(
        '--start-offset',
        type=float,
        default=0.0,
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
    parser.add_argument(
        '-m',
        '--remap',
        nargs='+',
        default=(),
        metavar='FROM:=TO',
        help='publish topics under other names',
    )
    parser.add_argument(
        '--clock',
        type=float,
        nargs='?',
        const=40.0,
        default=0.0,
        metavar='HZ',
        help="publish the bag's time on /clock, and let the nodes use it",
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
        default=1000,
        metavar='MS',
        help='at the end wait this long for acknowledgements; 0: for ever, -1: not at all',
    )


def main(arguments: argparse.Namespace) -> int:
    """Run the verb; the exit status."""
    with BagReader(arguments.bag) as reader:
        topics = StereoTopics.find(reader)
        options = _player_options(arguments, topics)
        config = config_of_bag(arguments.config, arguments.bag)
        supervisor = Supervisor(
            NODES, _ros_arguments(arguments, topics.namespace, config), arguments.single_process
        )
        os.environ.update(transport_environment())
        stop = stop_on_signals()
        rclpy.init(args=None, signal_handler_options=SignalHandlerOptions.NO)
        try:
            supervisor.start()
            return _play(reader, options, topics, supervisor, stop)
        finally:
            supervisor.stop()
            rclpy.try_shutdown()


def _play(
    reader: BagReader,
    options: PlayerOptions,
    topics: StereoTopics,
    supervisor: Supervisor,
    stop: threading.Event,
) -> int:
    report = Report()
    node = rclpy.create_node('player', namespace=topics.namespace)
    player = Player(node, reader, options)
    monitor = Monitor(topics.namespace, report, player.wall_time_of)
    executor: Executor = EventsExecutor()
    for each in (node, monitor):
        executor.add_node(each)
    line = StatusLine()
    try:
        problem = _wait_for_nodes(executor, monitor, supervisor, stop)
        if not problem and not stop.is_set():
            player.start()
            problem = _watch(executor, monitor, player, supervisor, line, stop)
    finally:
        line.end()
        player.stop()
        executor.shutdown()
        monitor.destroy_node()
        node.destroy_node()
    if problem:
        print(f'binopos replay: {problem}', file=sys.stderr)
        return 2
    for topic, count in player.counts.items():
        role, side = topics.roles.get(topic, ('', ''))
        if role in ('compressed', 'raw'):
            report.images[side] += count
    print(report)
    if stop.is_set():
        return INTERRUPTED
    return 0 if report.filtered.stamps else 1


def _wait_for_nodes(
    executor: Executor, monitor: Monitor, supervisor: Supervisor, stop: threading.Event
) -> str:
    """Spin until the nodes are connected; '' or why they are not."""
    deadline = time.monotonic() + START
    settled: float | None = None
    while not stop.is_set() and (settled is None or time.monotonic() < settled):
        executor.spin_once(timeout_sec=0.05)
        if problem := supervisor.poll():
            return problem
        missing = monitor.missing()
        if missing and time.monotonic() > deadline:
            return f'the nodes did not connect within {START:g} s: {", ".join(missing)}'
        if not missing and settled is None:
            settled = time.monotonic() + SETTLE
    return ''


def _watch(
    executor: Executor,
    monitor: Monitor,
    player: Player,
    supervisor: Supervisor,
    line: StatusLine,
    stop: threading.Event,
) -> str:
    """Spin until the bag is played and all that it led to has arrived; '' or what went wrong."""
    finished: float | None = None
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.05)
        if problem := supervisor.poll():
            return problem
        line.show(monitor.newest)
        now = time.monotonic()
        if not player.finished.is_set():
            continue
        finished = finished or now
        newest = max(finished, monitor.last_pose)
        if now - newest > DRAIN and monitor.heard_since(newest):
            break
    return player.error


def _player_options(arguments: argparse.Namespace, topics: StereoTopics) -> PlayerOptions:
    return build(
        PlayerOptions,
        {
            'bag': str(arguments.bag),
            'rate': arguments.rate,
            'loop': arguments.loop,
            'start_offset': arguments.start_offset,
            'topics': tuple(arguments.topics) or tuple(topics.roles),
            'remap': tuple(arguments.remap),
            'clock': arguments.clock,
            'start_paused': arguments.start_paused,
            'wait_for_all_acked': arguments.wait_for_all_acked,
        },
    )


def _ros_arguments(
    arguments: argparse.Namespace, namespace: str, config: Path | None
) -> list[str]:
    words = ['-r', f'__ns:={namespace}'] if namespace != NAMESPACE else []
    if config is not None:
        words += ['--params-file', str(config)]
    if arguments.clock:
        words += ['-p', 'use_sim_time:=true']
    return [*words, *arguments.ros_arguments]
