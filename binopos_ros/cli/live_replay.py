"""The part of `binopos replay` that needs ROS: the player and the monitor, while the nodes run."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence

import rclpy
from rclpy.executors import Executor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo as CameraInfoMessage

from binopos_ros.bag import Record, messages
from binopos_ros.bag.definitions import jazzy
from binopos_ros.bag.playback import PlayerOptions
from binopos_ros.cli.rig_bag import RigBag
from binopos_ros.cli.status_line import StatusLine
from binopos_ros.cli.supervisor import Supervisor
from binopos_ros.node_options import Parameters
from binopos_ros.nodes.monitor import Monitor
from binopos_ros.nodes.player import offer_controls
from binopos_ros.nodes.playing import Latched, Player
from binopos_ros.nodes.running import overrides, stop_on_signals
from binopos_ros.nodes.status import Status
from binopos_ros.optics import CameraInfo
from binopos_ros.reasons import count_reason
from binopos_ros.report import Report

#: Seconds for the nodes to come up and find each other.
START = 30.0
#: Seconds from then on for every subscription to be connected; one that asks for another quality
#: of service than is offered never is.
CONNECT = 5.0
#: Seconds for what the nodes do not tell of to settle.
SETTLE = 0.5
#: Silence, in seconds, after which nothing more is expected of nodes that hold no pair.
#: Diagnostics come at 1 Hz.
DRAIN = 1.2
#: Silence, in seconds, that is the end also where a node keeps a pair, or says nothing.
LONGEST_DRAIN = 10.0


class Replay:
    """A bag on its way through the live nodes.

    Args:
        bag: as the rig's.
        options: how it is played.
        parameters: of the nodes, the player among them.
        calibration: camera_info by side, in the place of the bag's; empty: the bag's.
        report: is filled.

    Attributes:
        interrupted: whether a signal ended it.
    """

    def __init__(
        self,
        bag: RigBag,
        options: PlayerOptions,
        parameters: Parameters,
        calibration: Mapping[str, CameraInfo],
        report: Report,
    ) -> None:
        self._bag = bag
        self._options = options
        self._namespace = bag.rig.namespace or '/'
        self._parameters = parameters
        self._latched = {
            f'{bag.rig.namespace}/{side}/camera_info': _latched(bag.start_ns, info)
            for side, info in calibration.items()
        }
        self._report = report
        self._stop = threading.Event()

    @property
    def interrupted(self) -> bool:
        """Whether a signal ended it."""
        return self._stop.is_set()

    def run(self, supervisor: Supervisor, enclave: Sequence[str] = ()) -> str:
        """Start the nodes, play the bag, fill the report; '' or what went wrong.

        `enclave` are the words that give the player and the monitor their enclave.
        """
        self._stop = stop_on_signals()
        # Not the command line: a rule A:=B of `--remap` is the player's alone.
        rclpy.init(
            args=['--ros-args', *enclave] if enclave else [],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        try:
            supervisor.start()
            return self._play(supervisor)
        finally:
            supervisor.stop()
            rclpy.try_shutdown()

    def _play(self, supervisor: Supervisor) -> str:
        node = rclpy.create_node(
            'player',
            namespace=self._namespace,
            parameter_overrides=overrides(self._parameters.given('player')),
        )
        player = Player(node, self._bag, self._options, self._latched, self._on_published)
        offer_controls(node, player)
        monitor = Monitor(self._namespace, self._report, player.wall_time_of)
        status = Status(self._namespace)
        executor: Executor = EventsExecutor()
        for each in (node, monitor, status):
            executor.add_node(each)
        line = StatusLine()
        supervisor.report = line.report
        try:
            problem = self._wait_for_nodes(executor, monitor, supervisor)
            if not problem and not self.interrupted:
                player.start()
                problem = self._watch(
                    executor, monitor, player, supervisor, lambda: line.show(status.look())
                )
        finally:
            line.end()
            player.stop()
            executor.shutdown()
            for each in (status, monitor, node):
                each.destroy_node()
        self._report.fates.end()
        monitor.account(
            at_stamps=not self._parameters.of_node('smoother').get('output_rate'),
            interrupted=self.interrupted,
        )
        for note in (*self._bag.rig.notes, *self._bag.notes):
            self._report.note(note)
        for reason, count in self._bag.dropped.items():
            count_reason(self._report.others, reason, count)
        return problem

    def _on_published(self, record: Record) -> None:
        role = self._bag.rig.roles.get(record.topic)
        if role is not None and role.is_image:
            self._report.fates.saw(role.side, messages.serialized_stamp(record.data))

    def _wait_for_nodes(self, executor: Executor, monitor: Monitor, supervisor: Supervisor) -> str:
        """Spin until the nodes are connected; '' or why they are not."""
        deadline = time.monotonic() + START
        seen: float | None = None
        settled: float | None = None
        while not self.interrupted and (settled is None or time.monotonic() < settled):
            executor.spin_once(timeout_sec=0.05)
            if problem := supervisor.poll():
                return problem
            now = time.monotonic()
            if missing := monitor.missing():
                if now > deadline:
                    return f'the nodes did not connect within {START:g} s: {", ".join(missing)}'
                continue
            seen = seen or now
            if settled is None and (not monitor.unreached() or now > seen + CONNECT):
                settled = now + SETTLE
        return monitor.second_suite()

    def _watch(
        self,
        executor: Executor,
        monitor: Monitor,
        player: Player,
        supervisor: Supervisor,
        show: Callable[[], None],
    ) -> str:
        """Spin until the bag is played and all it led to has arrived; '' or what went wrong."""
        finished: float | None = None
        while not self.interrupted:
            executor.spin_once(timeout_sec=0.05)
            if problem := supervisor.poll():
                return problem
            now = time.monotonic()
            if not player.finished.is_set():
                show()
                continue
            finished = finished or now
            newest = max(finished, monitor.last_news)
            if now - newest > (DRAIN if monitor.is_done_since(newest) else LONGEST_DRAIN):
                break
        return player.error


def _latched(stamp_ns: int, info: CameraInfo) -> Latched:
    message = messages.camera_info(stamp_ns, '', info)
    return Latched(CameraInfoMessage, bytes(jazzy().serialize_cdr(message, messages.CAMERA_INFO)))
