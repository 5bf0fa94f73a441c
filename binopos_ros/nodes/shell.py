"""What every node of the suite shares: parameters from options, quality of service, spinning.

Parameters mirror the options dataclasses of the rooms (see `binopos_ros.parameters`). A change at
run time is judged as a whole by building the new options, and takes effect in the same call.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

import rclpy
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from binopos_ros.parameters import ParameterError, ParameterSpec, build, refuse_unknown, specs_of

RCLError = rclpy_implementation.RCLError

NAMESPACE = 'stereo'
#: Enough for a stage that is held up for a second at 30 Hz.
DEPTH = 30
#: Seconds after which a signal is heeded at the latest.
SIGNAL_LATENCY = 0.1
PUBLISHER_QOS = QoSProfile(depth=DEPTH)
SUBSCRIBER_QOS = QoSProfile(depth=DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT)

_TYPES = {
    bool: Parameter.Type.BOOL,
    int: Parameter.Type.INTEGER,
    float: Parameter.Type.DOUBLE,
    str: Parameter.Type.STRING,
    (tuple, float): Parameter.Type.DOUBLE_ARRAY,
    (tuple, int): Parameter.Type.INTEGER_ARRAY,
    (tuple, str): Parameter.Type.STRING_ARRAY,
}


class StageNode(Node):
    """A node of the suite: relative topic names under /stereo unless the namespace is remapped."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, namespace=NAMESPACE, **options)
        self._declared: list[tuple[type, str, Callable[[Any], None]]] = []
        self.add_on_set_parameters_callback(self._judge_change)
        self.add_post_set_parameters_callback(self._apply_change)

    def declare_options(
        self, options_type: type, apply: Callable[[Any], None], prefix: str = ''
    ) -> Any:
        """Declare one parameter per option and return the options as the user set them.

        `apply` receives the new options whenever a change at run time has been accepted.

        Raises:
            ParameterError: a value has the wrong type or is out of range.
        """
        specs = specs_of(options_type, prefix)
        for spec in specs.values():
            self._declare(spec)
        options = build(options_type, self._values(specs), prefix)
        self._declared.append((options_type, prefix, apply))
        return options

    def refuse_unknown_parameters(self) -> None:
        """To be called once everything is declared: refuse overrides that no parameter takes.

        Raises:
            ParameterError: an override names an unknown parameter.
        """
        declared = {name for name in self._parameters if not name.startswith('qos_overrides.')}
        given = [name for name in self._parameter_overrides if not name.startswith('qos_over')]
        refuse_unknown(given, declared)

    def publisher(self, message_type: type, topic: str) -> Publisher:
        """A reliable publisher whose quality of service can be overridden by parameters."""
        return self.create_publisher(
            message_type,
            topic,
            PUBLISHER_QOS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )

    def subscription(
        self, message_type: type, topic: str, callback: Callable[[Any], None], **options: Any
    ) -> Subscription:
        """A sensor-data subscription whose quality of service can be overridden by parameters."""
        return self.create_subscription(
            message_type,
            topic,
            callback,
            SUBSCRIBER_QOS,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            **options,
        )

    def _declare(self, spec: ParameterSpec) -> None:
        kind: Any = (tuple, spec.element) if spec.kind is tuple else spec.kind
        descriptor = ParameterDescriptor(
            name=spec.name, description=_description(spec), read_only=spec.read_only
        )
        if spec.limits is not None and kind is float:
            low, high = spec.limits
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        elif spec.limits is not None and kind is int:
            low, high = spec.limits
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        default = spec.default
        if default is None or default == ():
            # Unset, but of a known type: an empty list would be taken for bytes.
            default = _TYPES[kind]
        elif spec.kind is tuple:
            default = list(default)
        elif kind is float:
            default = float(default)
        try:
            self.declare_parameter(spec.name, default, descriptor)
        except InvalidParameterTypeException as error:
            msg = f'{error}; write a number with its decimal point where one is wanted'
            raise ParameterError(msg) from error
        except InvalidParameterValueException as error:
            given = self._parameter_overrides[spec.name].value
            limits = (
                f': it must lie in {spec.limits[0]} .. {spec.limits[1]}' if spec.limits else ''
            )
            msg = f'parameter {spec.name!r} is {given!r}{limits or f": {error}"}'
            raise ParameterError(msg) from error

    def _values(self, specs: dict[str, ParameterSpec]) -> dict[str, Any]:
        values = {}
        for name in specs:
            try:
                values[name] = self.get_parameter(name).value
            except ParameterUninitializedException:
                values[name] = None
        return values

    def _changed(self, options_type: type, prefix: str, changes: dict[str, Any]) -> Any:
        specs = specs_of(options_type, prefix)
        mine = {name: value for name, value in changes.items() if name in specs}
        if not mine:
            return None
        return build(options_type, self._values(specs) | mine, prefix)

    def _judge_change(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {parameter.name: parameter.value for parameter in parameters}
        try:
            for options_type, prefix, _ in self._declared:
                self._changed(options_type, prefix, changes)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply_change(self, parameters: list[Parameter]) -> None:
        changes = {parameter.name: parameter.value for parameter in parameters}
        for options_type, prefix, apply in self._declared:
            options = self._changed(options_type, prefix, changes)
            if options is not None:
                apply(options)


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
    for node in nodes:
        executor.add_node(node)
    try:
        # EventsExecutor.spin() never returns in the wheels of rclpy 7.1; spin_once does.
        while rclpy.ok() and not stop.is_set():
            executor.spin_once(timeout_sec=SIGNAL_LATENCY)
    finally:
        executor.shutdown()


def run(factories: Sequence[Callable[[], Node]], arguments: Sequence[str] | None = None) -> int:
    """Run nodes in this process until SIGINT or SIGTERM; the process's exit status.

    0 after a signal, 2 with one line on stderr where a parameter is refused.
    """
    nodes: list[Node] = []
    stop = stop_on_signals()
    try:
        rclpy.init(
            args=list(arguments) if arguments is not None else None,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        for factory in factories:
            nodes.append(_built(factory))
        spin(nodes, stop)
    except ExternalShutdownException:
        # A node has ended the context itself: the player at the end of its bag.
        return 0
    except _RefusedError as error:
        print(error, file=sys.stderr)
        return 2
    except RCLError as error:
        print(f'binopos_ros: the ROS arguments are refused: {one_line(error)}', file=sys.stderr)
        return 2
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


class _RefusedError(Exception):
    """A node that cannot start with the parameters it was given."""


def _built(factory: Callable[[], Node]) -> Node:
    try:
        return factory()
    except (ValueError, OSError) as error:
        name = factory.__name__.removesuffix('Node').lower()
        msg = f'{name}: {one_line(error)}'
        raise _RefusedError(msg) from error


def one_line(error: BaseException) -> str:
    """An error as one line of text."""
    return ' '.join(str(error).split())


def _description(spec: ParameterSpec) -> str:
    choices = f' ({", ".join(spec.choices)})' if spec.choices else ''
    return spec.description + choices
