"""What `binopos run` and `binopos replay` tell in the terminal while the nodes run."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from binopos_ros.capture.transport import TRANSPORTS_VARIABLE
from binopos_ros.node_options import Parameters
from binopos_ros.nodes.interfaces import installed_class
from binopos_ros.nodes.running import SIGNAL_LATENCY, RCLError, UnknownROSArgsError
from binopos_ros.nodes.shell import NAMESPACE, one_line, sensor_data
from binopos_ros.view.screen import DIAGNOSTICS, TOPICS, Instant, Screen
from binopos_ros.view.status import status_text

#: Of `screen.TOPICS`, those that the line is made of.
HEARD = ('target/pose', 'target/health', DIAGNOSTICS)
#: s between two texts, as a person reads them.
PERIOD = 0.25
#: s for the first pose to come, before it is told that none has.
START = 10.0


class Status(Node):
    """Hears the suite and tells it in one line; nothing else, not even parameters.

    Attributes:
        text: the line, as of `PERIOD` ago at the most while the node is spun; '' until the first
            pose has come, or is overdue.
    """

    def __init__(self, namespace: str, context: Context | None = None) -> None:
        super().__init__(
            'status',
            namespace=namespace,
            context=context,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self.text = ''
        self._screen = Screen()
        for topic in HEARD:
            message_class = installed_class(TOPICS[topic])
            assert message_class is not None
            self.create_subscription(
                message_class, topic, partial(self._take, topic), sensor_data()
            )
        self._due = 0.0
        self._until: float | None = None

    def look(self) -> str:
        """The line as it is now; for the thread that spins the node."""
        instant = _now()
        if self._until is None:
            self._until = instant.now + START
        if instant.now >= self._due:
            self._due = instant.now + PERIOD
            numbers = self._screen.numbers(instant)
            if numbers['pose'] or instant.now > self._until:
                self.text = status_text(numbers)
        return self.text

    def _take(self, topic: str, message: Any) -> None:
        self._screen.take(topic, message, _now())


class StatusThread:
    """A `Status` in a context and a thread of its own, for a process that keeps nodes up.

    It hears over UDP alone: shared memory that is full kills whoever writes into it, and this
    process has nodes to keep up.

    Args:
        words: those after `--ros-args`, from which it takes the namespace.

    Attributes:
        problem: why there is no status, '' where there is one.
    """

    def __init__(self, words: Sequence[str]) -> None:
        self.text = ''
        self.problem = ''
        self._context = Context()
        self._stop = threading.Event()
        others = Parameters(words=words).others
        kept = os.environ.get(TRANSPORTS_VARIABLE)
        os.environ[TRANSPORTS_VARIABLE] = 'UDPv4'
        try:
            rclpy.init(
                args=['--ros-args', *others] if others else [],
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            self._node = Status(NAMESPACE, self._context)
        except (RCLError, UnknownROSArgsError) as error:
            self.problem = f'no status is shown: {one_line(error)}'
            return
        finally:
            if kept is None:
                del os.environ[TRANSPORTS_VARIABLE]
            else:
                os.environ[TRANSPORTS_VARIABLE] = kept
        self._thread = threading.Thread(target=self._run, name='status', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and what it hears with."""
        self._stop.set()
        if not self.problem:
            self._thread.join()
        rclpy.try_shutdown(context=self._context)

    def _run(self) -> None:
        executor = EventsExecutor(context=self._context)
        executor.add_node(self._node)
        try:
            while not self._stop.is_set() and self._context.ok():
                executor.spin_once(timeout_sec=SIGNAL_LATENCY)
                self.text = self._node.look()
        finally:
            executor.shutdown()
            self._node.destroy_node()


def _now() -> Instant:
    return Instant(time.monotonic(), time.time())
