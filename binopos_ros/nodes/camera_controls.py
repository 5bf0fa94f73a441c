"""The cameras' controls as ROS parameters: `left.controls.gain` and so on; -1 leaves it alone."""

from __future__ import annotations

from collections.abc import Callable

from rcl_interfaces.msg import (
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from binopos_ros.capture.controls import Control
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.recovery import SteadyCamera
from binopos_ros.parameters import CONTROLS

LEAVE_ALONE = -1
_TYPES = {'string': ParameterType.PARAMETER_STRING}


class ControlParameters:
    """Declares every control of every camera once the camera has been seen, and applies changes.

    :param report: takes one line where a camera refuses a change.
    """

    def __init__(self, node: Node, report: Callable[[str], None]) -> None:
        self._node = node
        self._report = report
        self._cameras: dict[str, SteadyCamera] = {}
        self._described: dict[str, dict[str, Control]] = {}
        node.add_on_set_parameters_callback(self._judge)
        node.add_post_set_parameters_callback(self._apply)

    def given(self, side: str) -> dict[str, int | str]:
        """The values that the user set for a side's controls at the start."""
        values = {}
        for name, parameter in self._node._parameter_overrides.items():
            where, infix, control = name.partition(CONTROLS)
            if where == side and infix:
                if parameter.value != LEAVE_ALONE:
                    values[control] = parameter.value
                # Known before the camera is: it may be plugged in only later.
                self._node.declare_parameter(name, parameter.value)
        return values

    def attach(self, side: str, camera: SteadyCamera) -> None:
        """Have changes of a side's parameters reach this camera."""
        self._cameras[side] = camera
        self.describe(side)

    def describe(self, side: str) -> None:
        """Declare the controls that the camera has, unless that has been done."""
        controls = self._cameras[side].controls
        if self._described.get(side) == controls:
            return
        self._described[side] = controls
        for control in controls.values():
            name = f'{side}{CONTROLS}{control.name}'
            descriptor = _descriptor(name, control)
            if not self._node.has_parameter(name):
                default = '' if control.kind == 'string' else LEAVE_ALONE
                self._node.declare_parameter(name, default, descriptor)
            elif not control.read_only:
                self._redescribe(side, control, descriptor)

    def _redescribe(self, side: str, control: Control, descriptor: ParameterDescriptor) -> None:
        try:
            self._node.set_descriptor(descriptor.name, descriptor)
        except InvalidParameterValueException as error:
            # Set before the camera was there to say what it takes.
            self._cameras[side].leave_control(control.name)
            self._report(f'{descriptor.name} is not in force: {error}')

    def _judge(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            control = self._control(parameter.name)
            if control is None or parameter.value in (LEAVE_ALONE, ''):
                continue
            fault = control.fault(parameter.value)
            if fault:
                return SetParametersResult(successful=False, reason=fault)
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            control = self._control(parameter.name)
            if control is None:
                continue
            camera = self._cameras[parameter.name.partition(CONTROLS)[0]]
            if parameter.value in (LEAVE_ALONE, ''):
                camera.leave_control(control.name)
                continue
            try:
                camera.set_control(control.name, parameter.value)
            except CaptureError as error:
                self._report(f'{parameter.name} is not in force: {error}')

    def _control(self, name: str) -> Control | None:
        side, _, control = name.partition(CONTROLS)
        return self._described.get(side, {}).get(control)


def _descriptor(name: str, control: Control) -> ParameterDescriptor:
    default = '' if control.kind in ('button', 'string') else f', default {control.default}'
    descriptor = ParameterDescriptor(
        name=name,
        description=f'{control.label} ({control.choices}{default}); '
        + ('empty' if control.kind == 'string' else '-1')
        + ' leaves it alone',
        additional_constraints=control.choices,
        read_only=control.read_only,
        type=_TYPES.get(control.kind, ParameterType.PARAMETER_INTEGER),
    )
    if control.kind != 'string':
        lowest, highest = (
            (0, 1) if control.kind == 'button' else (control.minimum, control.maximum)
        )
        descriptor.integer_range = [
            IntegerRange(from_value=min(lowest, LEAVE_ALONE), to_value=max(highest, LEAVE_ALONE))
        ]
    return descriptor
