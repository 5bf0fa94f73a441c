"""Frames out of the driver's buffers, one after the other: `for frame in stream`.

The frame's bytes lie in a buffer that the driver writes into again: they are valid until the next
frame is asked for, and whoever wants to keep them copies them once. Stamps are nanoseconds of
CLOCK_MONOTONIC.
"""

from __future__ import annotations

import array
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from typing import Any, Protocol

from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.errors import FAILED, FROZEN, CaptureError, broken

_POLL_SLICE = 0.1
_PAUSE_AFTER_FALSE_ALARM = 0.001
_SEQUENCE_SPAN = 1 << 32


class Streaming(Protocol):
    """What a stream needs of the device that it is of."""

    path: str

    def ioctl(self, request: int, argument: Any) -> None:
        """Make a request of the driver; OSError as the driver answers."""

    def map(self, length: int, offset: int) -> Any:
        """Map one of the driver's buffers into this process."""

    def poll(self, timeout: float) -> bool:
        """Wait up to `timeout` seconds for a frame (or for trouble)."""


@dataclass(frozen=True)
class Frame:
    """One frame in the driver's buffer.

    :ivar data: the bytes, valid until the next frame is asked for.
    :ivar sequence: the driver's count.
    :ivar lost: how many frames the driver left out since the one before.
    :ivar stamp_ns: when it was taken, on CLOCK_MONOTONIC.
    :ivar stamped_by_kernel: False where the driver stamps by another clock, or none, and
        `stamp_ns` is the time at which the frame was fetched.
    :ivar corrupt: the driver flags the bytes as damaged.
    """

    data: memoryview
    sequence: int
    lost: int
    stamp_ns: int
    stamped_by_kernel: bool
    corrupt: bool


class Stream(AbstractContextManager['Stream'], Iterator[Frame]):
    """A device that streams. Made by `Device.stream`; use it in a `with`.

    :raises CaptureError: where the device is gone, busy, frozen or broken.
    """

    def __init__(
        self, device: Streaming, buffers: int, timeout: float, interrupted: Callable[[], bool]
    ) -> None:
        self._device = device
        self._timeout = timeout
        self._interrupted = interrupted
        self._maps: list[Any] = []
        self._held: tuple[memoryview, memoryview, v4l2.Buffer] | None = None
        self._last_sequence: int | None = None
        self._empty = 0
        self._open = True
        try:
            self._start(buffers)
        except OSError as error:
            self.close()
            raise broken(error, 'start streaming', device.path) from error

    def __exit__(self, *_: object) -> None:
        self.close()

    def __next__(self) -> Frame:
        if not self._open:
            raise StopIteration
        try:
            self._give_back()
            buffer = self._fetch()
        except OSError as error:
            raise broken(error, 'go on streaming', self._device.path) from error
        if buffer is None:
            raise StopIteration
        return self._as_frame(buffer)

    def close(self) -> None:
        """Stop streaming and unmap the buffers, whatever state the device is in."""
        if not self._open:
            return
        self._open = False
        kind = v4l2.u32(v4l2.BUF_TYPE_VIDEO_CAPTURE)
        with suppress(OSError):
            self._device.ioctl(v4l2.VIDIOC_STREAMOFF, kind)
        self._release()
        for mapped in self._maps:
            # A view that somebody still holds keeps its buffer mapped until it is dropped.
            with suppress(BufferError):
                mapped.close()
        self._maps.clear()
        with suppress(OSError):
            self._device.ioctl(v4l2.VIDIOC_REQBUFS, _request_buffers(0))

    def _start(self, buffers: int) -> None:
        device = self._device
        request = _request_buffers(buffers)
        device.ioctl(v4l2.VIDIOC_REQBUFS, request)
        for index in range(request.count):
            buffer = _buffer(index)
            device.ioctl(v4l2.VIDIOC_QUERYBUF, buffer)
            self._maps.append(device.map(buffer.length, buffer.m.offset))
            device.ioctl(v4l2.VIDIOC_QBUF, _buffer(index))
        device.ioctl(v4l2.VIDIOC_STREAMON, v4l2.u32(v4l2.BUF_TYPE_VIDEO_CAPTURE))

    def _fetch(self) -> v4l2.Buffer | None:
        deadline = time.monotonic() + self._timeout
        while True:
            if self._interrupted():
                return None
            left = deadline - time.monotonic()
            if left <= 0.0:
                message = (
                    f'{self._device.path}: no frame for {self._timeout:g} s: it is frozen, or '
                    'its exposure is longer than that'
                )
                raise CaptureError(message, FROZEN)
            if not self._device.poll(min(left, _POLL_SLICE)):
                continue
            buffer = _buffer(0)
            try:
                self._device.ioctl(v4l2.VIDIOC_DQBUF, buffer)
            except BlockingIOError:
                time.sleep(_PAUSE_AFTER_FALSE_ALARM)
                continue
            return buffer

    def _as_frame(self, buffer: v4l2.Buffer) -> Frame:
        arrived_ns = time.monotonic_ns()
        corrupt = bool(buffer.flags & v4l2.BUF_FLAG_ERROR)
        self._empty = self._empty + 1 if corrupt and not buffer.bytesused else 0
        if self._empty >= len(self._maps):
            # So does uvcvideo when its transfers fail (a halted endpoint), and then falls silent.
            message = (
                f'{self._device.path}: the driver gave all buffers back empty: the device failed; '
                'replug it if it stays so'
            )
            raise CaptureError(message, FAILED)
        whole = memoryview(self._maps[buffer.index])
        data = whole[: min(buffer.bytesused, len(whole))]
        self._held = (whole, data, buffer)
        clock = buffer.flags & v4l2.BUF_FLAG_TIMESTAMP_MASK
        by_kernel = clock == v4l2.BUF_FLAG_TIMESTAMP_MONOTONIC
        stamp = buffer.timestamp
        lost = 0
        if self._last_sequence is not None:
            ahead = (buffer.sequence - self._last_sequence) % _SEQUENCE_SPAN
            # A count that goes back was restarted by the driver, and tells nothing.
            lost = ahead - 1 if 0 < ahead < _SEQUENCE_SPAN // 2 else 0
        self._last_sequence = buffer.sequence
        return Frame(
            data=data,
            sequence=buffer.sequence,
            lost=lost,
            stamp_ns=(
                stamp.tv_sec * 1_000_000_000 + stamp.tv_usec * 1000 if by_kernel else arrived_ns
            ),
            stamped_by_kernel=by_kernel,
            corrupt=corrupt,
        )

    def _give_back(self) -> None:
        buffer = self._release()
        if buffer is not None:
            self._device.ioctl(v4l2.VIDIOC_QBUF, _buffer(buffer.index))

    def _release(self) -> v4l2.Buffer | None:
        if self._held is None:
            return None
        whole, data, buffer = self._held
        self._held = None
        for view in (data, whole):
            with suppress(BufferError):
                view.release()
        return buffer


def copied(data: memoryview) -> array.array[int]:
    """Copy a frame's bytes once, into what a ROS message takes as its data without copying.

    An `array` made from a memoryview would go element by element, and a message copies `bytes`.
    """
    payload = array.array('B')
    payload.frombytes(data)
    return payload


def _buffer(index: int) -> v4l2.Buffer:
    return v4l2.Buffer(index=index, type=v4l2.BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.MEMORY_MMAP)


def _request_buffers(count: int) -> v4l2.RequestBuffers:
    return v4l2.RequestBuffers(
        count=count, type=v4l2.BUF_TYPE_VIDEO_CAPTURE, memory=v4l2.MEMORY_MMAP
    )
