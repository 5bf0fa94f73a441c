"""Running nodes in a process: parameters from the command line, spinning, signals."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from binopos_ros.capture.transport import full_memory_notice, network_environment
from binopos_ros.node_options import Parameters
from binopos_ros.nodes.shell import is_empty_list, one_line
from binopos_ros.nodes.supervised import Heart, bear_name, is_supervised
from binopos_ros.parameters import ParameterError

RCLError = rclpy_implementation.RCLError
UnknownROSArgsError = rclpy_implementation.UnknownROSArgsError

#: Seconds after which a signal is heeded at the latest.
SIGNAL_LATENCY = 0.1


def stop_on_signals() -> threading.Event:
    """The event that SIGINT and SIGTERM set from now on.

    rclpy's own handlers end the context under callbacks that are just publishing; with this, ROS
    ends when nothing runs any more. To be called before `rclpy.init`, which then takes
    `SignalHandlerOptions.NO`.
    """
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


def spin(nodes: Sequence[Node], stop: threading.Event) -> None:
    """Run the nodes until `stop` is set or their context is shut down."""
    executor = EventsExecutor()
    heart = Heart()
    for node in nodes:
        executor.add_node(node)
    heart.beat()
    bear_name(nodes[0].get_name())
    try:
        # EventsExecutor.spin() never returns in the wheels of rclpy 7.1; spin_once does.
        while rclpy.ok() and not stop.is_set():
            executor.spin_once(timeout_sec=SIGNAL_LATENCY)
            heart.beat()
    finally:
        executor.shutdown()


def run(factories: Mapping[str, Callable[..., Node]], words: Sequence[str]) -> int:
    """Run nodes in this process until SIGINT or SIGTERM; the process's exit status.

    0 after a signal, 2 with one line on stderr where a parameter is refused.

    Args:
        factories: node -> what makes it, with its `parameter_overrides`.
        words: those after `--ros-args`. Parameters are read by `binopos_ros.node_options`, which
            the verbs use as well, and not by rcl.
    """
    nodes: list[Node] = []
    stop = stop_on_signals()
    try:
        given = Parameters(words=words)
        if not is_supervised():
            for notice in given.notices():
                print(notice, file=sys.stderr)
            if network := network_environment(1):
                print(full_memory_notice(), file=sys.stderr)
                os.environ.update(network)
        rclpy.init(
            args=['--ros-args', *given.others] if given.others else [],
            signal_handler_options=SignalHandlerOptions.NO,
        )
        for name, factory in factories.items():
            nodes.append(_built(name, factory, given))
        spin(nodes, stop)
    except ExternalShutdownException:
        # A node has ended the context itself: the player at the end of its bag.
        return 0
    except _RefusedError as error:
        print(error, file=sys.stderr)
        return 2
    except ParameterError as error:
        print(f'binopos_ros: {error}', file=sys.stderr)
        return 2
    except (RCLError, UnknownROSArgsError) as error:
        print(f'binopos_ros: ROS does not start: {one_line(error)}', file=sys.stderr)
        return 2
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


class _RefusedError(Exception):
    """A node that cannot start with the parameters it was given."""


def _built(name: str, factory: Callable[..., Node], given: Parameters) -> Node:
    try:
        return factory(parameter_overrides=overrides(given.given(name)))
    except (ValueError, OSError) as error:
        msg = f'{name}: {one_line(error)}'
        raise _RefusedError(msg) from error


def overrides(values: Mapping[str, Any]) -> list[Parameter]:
    """Values as overrides of a node; those that are unset or empty keep their default."""
    return [
        Parameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in values.items()
        if value is not None and not is_empty_list(value)
    ]
