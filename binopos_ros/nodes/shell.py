"""What every node of the suite shares: parameters from options, quality of service, timers.

Parameters mirror the options dataclasses of the rooms (see `binopos_ros.parameters`). A change at
run time is judged as a whole by building the new options, and takes effect in the same call; one
that fits only together with another, as the layers of an interface do, waits for that other one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
)
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from binopos_ros.nodes.losses import Counted
from binopos_ros.parameters import (
    QOS_OVERRIDES,
    ParameterError,
    ParameterSpec,
    UnfinishedError,
    build,
    specs_of,
)

NAMESPACE = 'stereo'
#: Enough for a stage that is held up for a second at 30 Hz.
DEPTH = 30
#: Seconds between looks at who is there.
LOOK_PERIOD = 0.35
#: What `qos_overrides.TOPIC.subscription.*` and `.publisher.*` may change.
POLICIES = (
    QoSPolicyKind.HISTORY,
    QoSPolicyKind.DEPTH,
    QoSPolicyKind.RELIABILITY,
    QoSPolicyKind.DURABILITY,
)

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
        self._declared: list[_Declared] = []
        #: Full names of the topics that only one node should publish.
        self.sole_topics: set[str] = set()
        #: Messages that were sent to this node and never came, by topic.
        self.lost: Counter[str] = Counter()
        self._counted_topics: dict[str, Counted] = {}
        self._offered: list[Publisher] = []
        self.add_pre_set_parameters_callback(self._with_kinds)
        self.add_on_set_parameters_callback(self._judge_change)
        self.add_post_set_parameters_callback(self._apply_change)

    def declare_options(
        self,
        options_type: type,
        apply: Callable[[Any], None],
        judge: Callable[[Any], object] = lambda _: None,
    ) -> Any:
        """Declare one parameter per option and return the options as the user set them.

        `apply` receives the new options whenever a change at run time has been accepted; before
        that, `judge` raises a ValueError where they cannot be used.

        Raises:
            ParameterError: a value has the wrong type or is out of range.
        """
        specs = specs_of(options_type)
        for spec in specs.values():
            self._declare(spec)
        options = build(options_type, self._values(specs))
        self._declared.append(_Declared(options_type, apply, judge))
        return options

    def every(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """A timer of the machine's own time, which runs on where /clock stands or is absent."""
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        return self.create_timer(seconds, callback, clock=clock)

    def publisher(self, message_type: type, topic: str) -> Publisher:
        """A reliable publisher whose quality of service can be overridden by parameters.

        Raises:
            ParameterError: an override cannot be used.
        """
        made: Publisher = self._overridable(
            topic, self.create_publisher, message_type, topic, QoSProfile(depth=DEPTH)
        )
        self._offered.append(made)
        return made

    def reached(self) -> dict[str, int]:
        """How many subscriptions each topic of `publisher` reaches, by its full name.

        The graph may know of more: connections are made after that, and what is published before
        is lost on them.
        """
        return {each.topic_name: each.get_subscription_count() for each in self._offered}

    def subscription(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        sole: bool = True,
        profile: QoSProfile | None = None,
        **options: Any,
    ) -> Subscription:
        """A subscription whose quality of service can be overridden by parameters.

        It asks for sensor data, or for a `profile` that it has to itself.
        A second publisher is reported where the topic should have a `sole` one; what was lost on
        such a topic is counted in `lost`.

        Raises:
            ParameterError: an override cannot be used.
        """
        if sole:
            self.sole_topics.add(self.resolve_topic_name(topic))
            counted = Counted(callback, partial(self._lose, topic))
            callback = counted
            self._counted_topics[topic] = counted
            options.setdefault('event_callbacks', counted.events())
        return self._overridable(
            topic,
            self.create_subscription,
            message_type,
            topic,
            callback,
            profile or sensor_data(),
            **options,
        )

    def clock_troubles(self) -> dict[str, str]:
        """What is wrong with the clocks of those who send, by topic, since the last call."""
        found = {topic: counted.clock_trouble() for topic, counted in self._counted_topics.items()}
        return {topic: f'{topic} {trouble}' for topic, trouble in found.items() if trouble}

    def _lose(self, topic: str, count: int) -> None:
        self.lost[topic] += count

    def latched_subscription(
        self, message_type: type, topic: str, callback: Callable[[Any], None]
    ) -> None:
        """As `subscription`, and what latched publishers sent before this node was there.

        A subscription that asks for what was sent before does not hear publishers that do not keep
        it. So it is a second one, made where a latched publisher is seen; what comes by both comes
        twice.
        """
        self.subscription(message_type, topic, callback)
        full_name = self.resolve_topic_name(topic)
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)

        def look() -> None:
            offers = [each.qos_profile for each in self.get_publishers_info_by_topic(full_name)]
            if any(each.durability == latched.durability for each in offers):
                timer.cancel()
                # Other publishers may be plain, and are heard by the first one.
                quiet = SubscriptionEventCallbacks(incompatible_qos=lambda _: None)
                self.create_subscription(
                    message_type, topic, callback, latched, event_callbacks=quiet
                )

        timer = self.every(LOOK_PERIOD, look)

    def _overridable(
        self, topic: str, create: Callable[..., Any], *arguments: Any, **options: Any
    ) -> Any:
        """What `create` makes with the overrides; the profile is written into, so not shared."""
        overriding = QoSOverridingOptions(POLICIES)
        full_name = self.resolve_topic_name(topic)
        try:
            made = create(*arguments, qos_overriding_options=overriding, **options)
        except (RuntimeError, ParameterException, InvalidQosOverridesError) as error:
            msg = f'{QOS_OVERRIDES}{full_name} cannot be used: {one_line(error)}'
            raise ParameterError(msg) from error
        kind = 'publisher' if isinstance(made, Publisher) else 'subscription'
        prefix = f'{QOS_OVERRIDES}{full_name}.{kind}.'
        for name in self._parameter_overrides:
            if name.startswith(prefix) and not self.has_parameter(name):
                known = ', '.join(policy.name.lower() for policy in POLICIES)
                msg = f'unknown parameter {name!r}: the policies are {known}'
                raise ParameterError(msg)
        return made

    def _declare(self, spec: ParameterSpec) -> None:
        kind: Any = (tuple, spec.element) if spec.kind is tuple else spec.kind
        default = spec.default
        if default is None or default == ():
            # Unset, but of a known type: an empty list would be taken for bytes.
            default = _TYPES[kind]
        elif spec.kind is tuple:
            default = list(default)
        elif kind is float:
            default = float(default)
        is_unset = isinstance(default, Parameter.Type)
        try:
            # What is read-only could not get its empty list afterwards.
            descriptor = _descriptor(spec, read_only=spec.read_only and not is_unset)
            self.declare_parameter(spec.name, default, descriptor)
            if is_unset and spec.kind is tuple:
                # A parameter without a value would keep all others from being asked for.
                if self.get_parameter_or(spec.name).type_ == Parameter.Type.NOT_SET:
                    self.set_parameters([Parameter(spec.name, default, [])])
                final = _descriptor(spec, spec.read_only)
                final.type = default.value
                self.set_descriptor(spec.name, final)
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

    def _with_kinds(self, parameters: list[Parameter]) -> list[Parameter]:
        """Empty lists, of which ROS's tools do not know what they are empty of, by their kind."""
        return [
            Parameter(each.name, Parameter.Type(self.describe_parameter(each.name).type), [])
            if self.has_parameter(each.name) and is_empty_list(each.value)
            else each
            for each in parameters
        ]

    def _changed(self, declared: _Declared, parameters: list[Parameter]) -> Any:
        specs = specs_of(declared.options_type)
        mine = {each.name: each.value for each in parameters if each.name in specs}
        return build(declared.options_type, self._values(specs) | mine) if mine else None

    def _judge_change(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            for declared in self._declared:
                options = self._changed(declared, parameters)
                if options is not None:
                    declared.judge(options)
        except UnfinishedError:
            # The rest may come with the next change.
            return SetParametersResult(successful=True)
        except (ValueError, OSError) as error:
            return SetParametersResult(successful=False, reason=one_line(error))
        return SetParametersResult(successful=True)

    def _apply_change(self, parameters: list[Parameter]) -> None:
        for declared in self._declared:
            try:
                options = self._changed(declared, parameters)
                if options is not None:
                    declared.apply(options)
            except (ValueError, OSError) as error:
                self.get_logger().warning(f'not in force yet: {one_line(error)}')


class _Declared(NamedTuple):
    """Options whose parameters a node has declared, and what becomes of a change."""

    options_type: type
    apply: Callable[[Any], None]
    judge: Callable[[Any], object]


def sensor_data() -> QoSProfile:
    """What a stage asks for; a profile of its own for each, as rclpy writes overrides into it."""
    return QoSProfile(depth=DEPTH, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def every_message() -> QoSProfile:
    """What a stage asks for that is to work on everything, however late."""
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_ALL, reliability=QoSReliabilityPolicy.BEST_EFFORT
    )


def is_empty_list(value: Any) -> bool:
    """Whether a parameter's value is a list without items."""
    return hasattr(value, '__len__') and not isinstance(value, str) and len(value) == 0


def one_line(error: BaseException) -> str:
    """An error as one line of text."""
    return ' '.join(str(error).split())


def _descriptor(spec: ParameterSpec, read_only: bool) -> ParameterDescriptor:
    choices = f' ({", ".join(spec.choices)})' if spec.choices else ''
    descriptor = ParameterDescriptor(
        name=spec.name, description=spec.description + choices, read_only=read_only
    )
    if spec.limits is not None:
        low, high = spec.limits
        if spec.kind is float:
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=float(low), to_value=float(high))
            ]
        elif spec.kind is int:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    return descriptor
