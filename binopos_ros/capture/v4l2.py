"""Cameras by Video4Linux: what a device offers, how it is set up, and its frames.

    with Device('/dev/video0') as device:
        device.set_format('MJPG', 1280, 960, frame_rate=30.0)
        with device.stream() as stream:
            for frame in stream:
                keep(bytes(frame.data))

The frame's bytes lie in a buffer that the driver writes into again: they are valid until the next
frame is asked for. Sizes are in pixels, rates in frames per second, stamps in nanoseconds of the
kernel's monotonic clock.
"""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from binopos_ros.capture import controls as _controls
from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.controls import Control
from binopos_ros.capture.errors import CaptureError, refused
from binopos_ros.capture.kernel import Kernel, Linux
from binopos_ros.capture.stream import Stream

_MODES_IN_A_LINE = 40


@dataclass(frozen=True)
class Capabilities:
    """Who the driver says it is, and what this node of it can do."""

    driver: str
    card: str
    bus: str
    capture: bool
    streaming: bool


@dataclass(frozen=True)
class Mode:
    """One pixel format in one size, or in a range of sizes, and its frame rates (1/s)."""

    pixel_format: str
    smallest: tuple[int, int]
    largest: tuple[int, int]
    step: tuple[int, int]
    rates: tuple[float, ...]

    def offers(self, width: int, height: int) -> bool:
        """Whether frames of this size (px) can be had."""
        return all(
            low <= size <= high and (size - low) % max(step, 1) == 0
            for size, low, high, step in zip(
                (width, height), self.smallest, self.largest, self.step, strict=True
            )
        )

    def __str__(self) -> str:
        size = '{}x{}'.format(*self.largest)
        if self.smallest != self.largest:
            size = '{}x{} to '.format(*self.smallest) + size
        rates = ', '.join(f'{rate:.4g}' for rate in self.rates)
        return f'{self.pixel_format} {size}' + (f' at {rates} /s' if rates else '')


@dataclass(frozen=True)
class Format:
    """What the device sends: `step` is the bytes per line (0 where compressed), `size` the most
    bytes a frame can have, `frame_rate` (1/s) is 0 where the driver does not say."""

    pixel_format: str
    width: int
    height: int
    step: int
    size: int
    frame_rate: float


class Device(AbstractContextManager['Device']):
    """A camera's device node, open.

    :raises CaptureError: where it is missing, busy, forbidden, or no camera.
    """

    def __init__(self, path: str, kernel: Kernel | None = None) -> None:
        self.path = path
        self.kernel: Kernel = kernel or Linux()
        try:
            self._descriptor = self.kernel.open(path)
        except OSError as error:
            raise refused(error, 'open it', path) from error
        try:
            self.capabilities = self._query_capabilities()
            self.controls = _controls.list_controls(self.kernel, self._descriptor, path)
        except CaptureError:
            self.close()
            raise

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Give the device back; a second time does nothing."""
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            self.kernel.close(descriptor)

    def ioctl(self, request: int, argument: Any) -> None:
        """Make a request of the driver.

        :raises OSError: as the driver answers; EBADF once closed.
        """
        if self._descriptor < 0:
            raise OSError(errno.ENODEV, 'closed')
        self.kernel.ioctl(self._descriptor, request, argument)

    def map(self, length: int, offset: int) -> Any:
        """Map one of the driver's buffers into this process."""
        return self.kernel.map(self._descriptor, length, offset)

    def poll(self, timeout: float) -> bool:
        """Wait up to `timeout` seconds for a frame (or for trouble)."""
        return self.kernel.poll(self._descriptor, timeout)

    def modes(self) -> list[Mode]:
        """Every pixel format, size and rate that the driver offers."""
        return [
            mode for pixel_format in self._pixel_formats() for mode in self._modes_of(pixel_format)
        ]

    def get_format(self) -> Format:
        """What the device is set to now."""
        request = v4l2.Format(type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
        self._ask(v4l2.VIDIOC_G_FMT, request, 'read its format')
        return self._as_format(request, self._frame_rate())

    def set_format(
        self, pixel_format: str, width: int, height: int, frame_rate: float = 0.0
    ) -> Format:
        """Set the pixel format ('MJPG', 'YUYV', ...), the size (px) and the frame rate (1/s).

        The driver takes the nearest rate that it has, which the returned format tells.

        :raises CaptureError: where the format or the size is not offered (those that are, are
            listed), or another program streams from the device.
        """
        request = v4l2.Format(type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
        pix = request.fmt.pix
        pix.width, pix.height = width, height
        pix.pixelformat = from_fourcc(pixel_format)
        pix.field = v4l2.FIELD_NONE
        try:
            self.ioctl(v4l2.VIDIOC_S_FMT, request)
            answer = (to_fourcc(pix.pixelformat), pix.width, pix.height)
        except OSError as error:
            if error.errno != errno.EINVAL:
                raise refused(error, 'set its format', self.path) from error
            answer = None
        if answer != (pixel_format, width, height):
            offered = _listing(self.modes(), pixel_format)
            message = f'{self.path}: no {pixel_format} {width}x{height}; it offers {offered}'
            raise CaptureError(message)
        return self._as_format(request, self._set_frame_rate(frame_rate))

    def get(self, name: str) -> int | str:
        """Read a control.

        :raises CaptureError: where there is no such control, or it cannot be read.
        """
        control = self._control(name)
        return _controls.read_control(self.kernel, self._descriptor, self.path, control)

    def set(self, name: str, value: int | str) -> None:
        """Set a control.

        :raises CaptureError: where there is no such control, or it does not take the value.
        """
        control = self._control(name)
        _controls.write_control(self.kernel, self._descriptor, self.path, control, value)

    def stream(
        self,
        buffers: int = 4,
        timeout: float = 1.0,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> Stream:
        """Stream frames in the format set before.

        :param buffers: how many frames the driver may fill before one has to be fetched.
        :param timeout: seconds without a frame after which the device counts as frozen.
        :param interrupted: asked several times a second; the iteration ends when it says so.
        """
        return Stream(self, buffers, timeout, interrupted)

    def _ask(self, request: int, argument: Any, what: str) -> None:
        try:
            self.ioctl(request, argument)
        except OSError as error:
            raise refused(error, what, self.path) from error

    def _query_capabilities(self) -> Capabilities:
        answer = v4l2.Capability()
        try:
            self.ioctl(v4l2.VIDIOC_QUERYCAP, answer)
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):
                message = f'{self.path}: not a camera; "binopos doctor" lists the cameras'
                raise CaptureError(message) from error
            raise refused(error, 'ask what it is', self.path) from error
        own = answer.capabilities & v4l2.CAP_DEVICE_CAPS
        able = answer.device_caps if own else answer.capabilities
        capabilities = Capabilities(
            driver=answer.driver.decode('utf-8', 'replace'),
            card=answer.card.decode('utf-8', 'replace'),
            bus=answer.bus_info.decode('utf-8', 'replace'),
            capture=bool(able & v4l2.CAP_VIDEO_CAPTURE),
            streaming=bool(able & v4l2.CAP_STREAMING),
        )
        if able & v4l2.CAP_VIDEO_CAPTURE_MPLANE:
            message = (
                f'{self.path}: {capabilities.card} sends its planes apart (multi-planar), which '
                'is not supported; use a USB camera, or its driver for ROS'
            )
            raise CaptureError(message)
        if not (capabilities.capture and capabilities.streaming):
            message = (
                f'{self.path}: {capabilities.card} sends no images on this node; '
                '"binopos doctor" lists the cameras'
            )
            raise CaptureError(message)
        return capabilities

    def _pixel_formats(self) -> Iterator[str]:
        for index in range(1024):
            answer = v4l2.FormatDescription(index=index, type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
            try:
                self.ioctl(v4l2.VIDIOC_ENUM_FMT, answer)
            except OSError as error:
                if error.errno == errno.EINVAL:
                    return
                raise refused(error, 'list its formats', self.path) from error
            yield to_fourcc(answer.pixelformat)

    def _modes_of(self, pixel_format: str) -> Iterator[Mode]:
        code = from_fourcc(pixel_format)
        for index in range(1024):
            answer = v4l2.FrameSizeEnumeration(index=index, pixel_format=code)
            try:
                self.ioctl(v4l2.VIDIOC_ENUM_FRAMESIZES, answer)
            except OSError as error:
                if error.errno in (errno.EINVAL, errno.ENOTTY):
                    return
                raise refused(error, 'list its sizes', self.path) from error
            if answer.type == v4l2.FRMSIZE_DISCRETE:
                size = (answer.size.discrete.width, answer.size.discrete.height)
                yield Mode(pixel_format, size, size, (1, 1), self._rates(code, *size))
            else:
                span = answer.size.stepwise
                largest = (span.max_width, span.max_height)
                yield Mode(
                    pixel_format,
                    (span.min_width, span.min_height),
                    largest,
                    (span.step_width, span.step_height),
                    self._rates(code, *largest),
                )
                return

    def _rates(self, code: int, width: int, height: int) -> tuple[float, ...]:
        rates = []
        for index in range(1024):
            answer = v4l2.FrameIntervalEnumeration(
                index=index, pixel_format=code, width=width, height=height
            )
            try:
                self.ioctl(v4l2.VIDIOC_ENUM_FRAMEINTERVALS, answer)
            except OSError:
                break
            if answer.type == v4l2.FRMIVAL_DISCRETE:
                rates.append(_rate(answer.interval.discrete))
            else:
                rates += [_rate(answer.interval.stepwise.min), _rate(answer.interval.stepwise.max)]
                break
        return tuple(rates)

    def _frame_rate(self) -> float:
        request = v4l2.StreamParameters(type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
        try:
            self.ioctl(v4l2.VIDIOC_G_PARM, request)
        except OSError:
            return 0.0  # many drivers have no rate to speak of
        return _rate(request.parm.capture.timeperframe)

    def _set_frame_rate(self, frame_rate: float) -> float:
        if frame_rate <= 0.0:
            return self._frame_rate()
        request = v4l2.StreamParameters(type=v4l2.BUF_TYPE_VIDEO_CAPTURE)
        interval = request.parm.capture.timeperframe
        interval.numerator, interval.denominator = 1000, round(1000 * frame_rate)
        try:
            self.ioctl(v4l2.VIDIOC_S_PARM, request)
        except OSError as error:
            if error.errno in (errno.ENOTTY, errno.EINVAL):
                return 0.0
            raise refused(error, 'set its frame rate', self.path) from error
        return _rate(interval)

    @staticmethod
    def _as_format(request: v4l2.Format, frame_rate: float) -> Format:
        pix = request.fmt.pix
        return Format(
            pixel_format=to_fourcc(pix.pixelformat),
            width=pix.width,
            height=pix.height,
            step=pix.bytesperline,
            size=pix.sizeimage,
            frame_rate=frame_rate,
        )

    def _control(self, name: str) -> Control:
        if name not in self.controls:
            known = ', '.join(self.controls) or 'none'
            message = f'{self.path}: no control {name!r}; its controls are {known}'
            raise CaptureError(message)
        return self.controls[name]


def _listing(modes: list[Mode], pixel_format: str) -> str:
    modes = [mode for mode in modes if mode.pixel_format == pixel_format] or modes
    if len(modes) <= _MODES_IN_A_LINE:
        return '; '.join(str(mode) for mode in modes)
    return 'the formats ' + ', '.join(sorted({mode.pixel_format for mode in modes}))


def to_fourcc(code: int) -> str:
    """Spell the kernel's number for a pixel format as its four letters ('MJPG').

    Where the format is the big-endian variety, '-BE' follows.
    """
    letters = bytes(code >> shift & 0x7F for shift in (0, 8, 16, 24)).decode('ascii')
    return letters.rstrip() + ('-BE' if code >> 31 else '')


def from_fourcc(name: str) -> int:
    """Give the kernel's number for a pixel format's four letters.

    :raises CaptureError: where the name is not of that kind.
    """
    letters = name.removesuffix('-BE').ljust(4)
    if len(letters) != 4 or not letters.isascii():
        message = f'pixel format {name!r}: four letters are meant, as in MJPG or YUYV'
        raise CaptureError(message)
    return int.from_bytes(letters.encode(), 'little') | (name.endswith('-BE') << 31)


def _rate(interval: v4l2.Fraction) -> float:
    return interval.denominator / interval.numerator if interval.numerator else 0.0
