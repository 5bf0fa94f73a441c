"""A camera's controls (exposure, gain, focus, ...) by name, with the ranges of its driver."""

from __future__ import annotations

import ctypes
import errno
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.errors import CaptureError, refused

if TYPE_CHECKING:
    from collections.abc import Iterator

    from binopos_ros.capture.kernel import Kernel

KINDS = {
    v4l2.CTRL_TYPE_INTEGER: 'integer',
    v4l2.CTRL_TYPE_BOOLEAN: 'boolean',
    v4l2.CTRL_TYPE_MENU: 'menu',
    v4l2.CTRL_TYPE_BUTTON: 'button',
    v4l2.CTRL_TYPE_INTEGER64: 'integer64',
    v4l2.CTRL_TYPE_STRING: 'string',
    v4l2.CTRL_TYPE_BITMASK: 'bitmask',
    v4l2.CTRL_TYPE_INTEGER_MENU: 'integer menu',
}
"""The kinds that are a single value; matrices and driver-private structures are left out."""


@dataclass(frozen=True)
class Control:
    """One control as the driver describes it.

    `name` is the label in lower case with underscores, as v4l2-ctl writes it. For a string,
    `minimum` and `maximum` are its length. `menu` maps each value that may be set to its label.
    """

    id: int
    name: str
    label: str
    kind: str
    minimum: int
    maximum: int
    step: int
    default: int
    read_only: bool = False
    write_only: bool = False
    inactive: bool = False
    menu: dict[int, str] = field(default_factory=dict)

    @property
    def choices(self) -> str:
        """What may be set, for a person to read."""
        if self.menu:
            return ', '.join(f'{value}: {label}' for value, label in self.menu.items())
        if self.kind == 'boolean':
            return '0: off, 1: on'
        if self.kind == 'button':
            return '1: press'
        if self.kind == 'bitmask':
            return f'bits of {self.maximum:#x}'
        step = f' in steps of {self.step}' if self.step > 1 else ''
        return f'{self.minimum} to {self.maximum}{step}'

    def fault(self, value: int | str) -> str:
        """Why the driver would not take the value; '' where it will."""
        if self.read_only:
            return f'{self.name} can only be read'
        if (self.kind == 'string') != isinstance(value, str):
            wanted = 'text' if self.kind == 'string' else self.choices
            return f'{self.name} = {value!r}: it takes {wanted}'
        if isinstance(value, str):
            length = len(value.encode())
            fits = self.minimum <= length <= self.maximum
            return '' if fits else f'{self.name} takes {self.choices} bytes, not {length}'
        if self.menu:
            fits = value in self.menu
        elif self.kind == 'bitmask':
            fits = value >= 0 and not value & ~self.maximum
        elif self.kind == 'button':
            fits = True
        else:
            fits = self.minimum <= value <= self.maximum
            fits = fits and (value - self.minimum) % max(self.step, 1) == 0
        return '' if fits else f'{self.name} = {value} is out of range: it takes {self.choices}'


def list_controls(kernel: Kernel, descriptor: int, path: str) -> dict[str, Control]:
    """Ask the driver for every control that is a single value, in the driver's order.

    :raises CaptureError: where the device is gone.
    """
    controls: dict[str, Control] = {}
    for query in _query_all(kernel, descriptor, path):
        if query.type not in KINDS or query.flags & v4l2.CTRL_FLAG_DISABLED:
            continue
        label = query.name.decode('utf-8', 'replace')
        name = re.sub('[^a-z0-9]+', '_', label.lower()).strip('_') or f'control_{query.id:08x}'
        if name in controls:
            name = f'{name}_{query.id:08x}'
        controls[name] = Control(
            id=query.id,
            name=name,
            label=label,
            kind=KINDS[query.type],
            minimum=query.minimum,
            maximum=_unsigned(query.maximum)
            if query.type == v4l2.CTRL_TYPE_BITMASK
            else query.maximum,
            step=query.step,
            default=query.default_value,
            read_only=bool(query.flags & v4l2.CTRL_FLAG_READ_ONLY),
            write_only=bool(query.flags & v4l2.CTRL_FLAG_WRITE_ONLY),
            inactive=bool(query.flags & v4l2.CTRL_FLAG_INACTIVE),
            menu=dict(_menu(kernel, descriptor, query)),
        )
    return controls


def read_control(kernel: Kernel, descriptor: int, path: str, control: Control) -> int | str:
    """Read the value that the device has now.

    :raises CaptureError: where it cannot be read, or the device is gone.
    """
    if control.write_only or control.kind == 'button':
        message = f'{path}: {control.name} can only be set, not read'
        raise CaptureError(message)
    request, text = _request(control)
    try:
        kernel.ioctl(descriptor, v4l2.VIDIOC_G_EXT_CTRLS, request)
    except OSError as error:
        raise refused(error, f'read {control.name}', path) from error
    content = request.controls[0].content
    if text is not None:
        return text.value.decode('utf-8', 'replace')
    if control.kind == 'integer64':
        return content.value64
    return _unsigned(content.value) if control.kind == 'bitmask' else content.value


def write_control(
    kernel: Kernel, descriptor: int, path: str, control: Control, value: int | str
) -> None:
    """Set the control.

    :raises CaptureError: where the value is out of range, the control is held by an automatic
        of the camera, or the device is gone.
    """
    fault = control.fault(value)
    if fault:
        message = f'{path}: {fault}'
        raise CaptureError(message)
    request, text = _request(control)
    if text is not None:
        text.value = str(value).encode()
    elif control.kind == 'integer64':
        request.controls[0].content.value64 = value
    else:
        request.controls[0].content.value = ctypes.c_int32(int(value)).value
    try:
        kernel.ioctl(descriptor, v4l2.VIDIOC_S_EXT_CTRLS, request)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EIO, errno.EBUSY) and control.inactive:
            message = (
                f'{path}: {control.name} is held by an automatic of the camera; '
                'switch the automatic off first'
            )
            raise CaptureError(message) from error
        raise refused(error, f'set {control.name} to {value}', path) from error


def in_order_of_setting(controls: dict[str, Control], names: list[str]) -> list[str]:
    """Put the switches before the values: an automatic locks the value that it drives."""
    switches = {name for name, one in controls.items() if one.kind in ('menu', 'boolean')}
    return sorted(names, key=lambda name: name not in switches)


def _unsigned(bits: int) -> int:
    return bits & 0xFFFFFFFF


def _query_all(kernel: Kernel, descriptor: int, path: str) -> Iterator[v4l2.QueryExtendedControl]:
    query = v4l2.QueryExtendedControl(id=v4l2.CTRL_FLAG_NEXT_CTRL)
    while True:
        try:
            kernel.ioctl(descriptor, v4l2.VIDIOC_QUERY_EXT_CTRL, query)
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return
            raise refused(error, 'list its controls', path) from error
        yield query
        query = v4l2.QueryExtendedControl(id=query.id | v4l2.CTRL_FLAG_NEXT_CTRL)


def _menu(
    kernel: Kernel, descriptor: int, query: v4l2.QueryExtendedControl
) -> Iterator[tuple[int, str]]:
    if query.type not in (v4l2.CTRL_TYPE_MENU, v4l2.CTRL_TYPE_INTEGER_MENU):
        return
    for index in range(query.minimum, query.maximum + 1):
        item = v4l2.QueryMenu(id=query.id, index=index)
        try:
            kernel.ioctl(descriptor, v4l2.VIDIOC_QUERYMENU, item)
        except OSError:
            continue  # a driver answers EINVAL for the entries that this camera lacks
        if query.type == v4l2.CTRL_TYPE_MENU:
            yield index, item.item.name.decode('utf-8', 'replace')
        else:
            yield index, str(item.item.value)


def _request(
    control: Control,
) -> tuple[v4l2.ExtendedControls, ctypes.Array[ctypes.c_char] | None]:
    text = None
    entry = v4l2.ExtendedControl(id=control.id)
    if control.kind == 'string':
        text = ctypes.create_string_buffer(control.maximum + 1)
        entry.size = control.maximum + 1
        entry.content.pointer = ctypes.addressof(text)
    array = (v4l2.ExtendedControl * 1)(entry)
    return v4l2.ExtendedControls(count=1, controls=array), text
