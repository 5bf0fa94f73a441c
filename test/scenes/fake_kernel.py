"""A kernel with cameras in it, behind the seam `binopos_ros.capture.kernel.Kernel`.

It keeps the books that a leak shows up in (descriptors, mappings, streams), refuses what the real
V4L2 core refuses, and goes wrong on demand.
"""

from __future__ import annotations

import ctypes
import errno
import os
import threading
import time
from collections import deque
from dataclasses import dataclass, field

from binopos_ros.capture import kernel as v4l2


def fourcc(name):
    return int.from_bytes(name.encode(), 'little')


@dataclass
class FakeControl:
    id: int
    label: str
    type: int = v4l2.CTRL_TYPE_INTEGER
    minimum: int = 0
    maximum: int = 100
    step: int = 1
    default: int = 50
    flags: int = 0
    menu: dict = field(default_factory=dict)
    value: object = None

    def __post_init__(self):
        if self.value is None:
            self.value = self.default


@dataclass
class FakeFrame:
    data: bytes
    sequence: int
    stamp_ns: int
    flags: int = v4l2.BUF_FLAG_TIMESTAMP_MONOTONIC


@dataclass
class FakeCamera:
    """`modes`: pixel format -> {(width, height): rates}; `span`: formats with a range of sizes."""

    modes: dict
    controls: list = field(default_factory=list)
    span: dict = field(default_factory=dict)
    card: str = 'Fake camera'
    capabilities: int = v4l2.CAP_VIDEO_CAPTURE | v4l2.CAP_STREAMING
    frames: deque = field(default_factory=deque)
    errors: dict = field(default_factory=dict)
    """request number -> errno, answered until taken out again"""
    gone: bool = False
    open_error: int = 0
    live: float = 0.0
    """frames per second that it makes by itself while it streams; 0: only what is in `frames`"""
    picture: bytes = b'\xff\xd8' + bytes(range(200)) + b'\xff\xd9'
    format: tuple = ('', 0, 0)
    rate: tuple = (1, 30)
    streaming: bool = False
    queued: deque = field(default_factory=deque)
    buffers: int = 0
    sequence: int = 0
    began_ns: int = 0
    taken: int = 0
    streams_started: int = 0

    def __post_init__(self):
        name = next(iter(self.modes))
        self.format = (name, *next(iter(self.modes[name])))


class FakeKernel:
    """Cameras by path. Every call is counted; `leaks` says what was not given back."""

    buffer_size = 4096

    def __init__(self, cameras):
        self.cameras = dict(cameras)
        self.descriptors = {}
        self.mappings = []
        self.next_descriptor = 100
        self.requests = []
        self.lock = threading.RLock()

    @property
    def leaks(self):
        return {
            'descriptors': len(self.descriptors),
            'mappings': sum(not mapping.closed for mapping in self.mappings),
            'streams': sum(camera.streaming for camera in self.cameras.values()),
        }

    def open(self, path):
        with self.lock:
            camera = self.cameras.get(path)
            if camera is None or camera.gone:
                raise OSError(errno.ENOENT, os.strerror(errno.ENOENT))
            if camera.open_error:
                raise OSError(camera.open_error, os.strerror(camera.open_error))
            self.next_descriptor += 1
            self.descriptors[self.next_descriptor] = camera
            return self.next_descriptor

    def close(self, descriptor):
        with self.lock:
            camera = self.descriptors.pop(descriptor)
            camera.streaming = False

    def map(self, descriptor, length, offset):
        mapping = FakeMapping(length)
        with self.lock:
            self.mappings = [kept for kept in self.mappings if not kept.closed] + [mapping]
            self.descriptors[descriptor].__dict__.setdefault('memory', {})[offset] = mapping
        return mapping

    def poll(self, descriptor, timeout):
        deadline = time.monotonic() + timeout
        while True:
            with self.lock:
                camera = self.descriptors[descriptor]
                if camera.gone or v4l2.VIDIOC_DQBUF in camera.errors or self._due(camera):
                    return True
            if time.monotonic() >= deadline:
                return False
            time.sleep(min(0.002, timeout))

    def ioctl(self, descriptor, request, argument):
        with self.lock:
            camera = self.descriptors[descriptor]
            self.requests.append(request)
            if camera.gone:
                raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
            if request in camera.errors:
                code = camera.errors[request]
                raise OSError(code, os.strerror(code))
            getattr(self, _HANDLERS[request])(camera, argument)

    def _due(self, camera):
        if camera.streaming and camera.live and not camera.frames:
            # By the camera's own clock, however late this process looks.
            stamp = camera.began_ns + round(camera.taken * 1e9 / camera.live)
            if time.monotonic_ns() >= stamp:
                camera.taken += 1
                camera.sequence += 1
                camera.frames.append(FakeFrame(camera.picture, camera.sequence, stamp))
        return bool(camera.frames and camera.queued)

    def _querycap(self, camera, answer):
        answer.driver, answer.card, answer.bus_info = b'fake', camera.card.encode(), b'usb-fake-1'
        answer.capabilities = camera.capabilities | v4l2.CAP_DEVICE_CAPS
        answer.device_caps = camera.capabilities

    def _enum_fmt(self, camera, answer):
        names = [*camera.modes, *camera.span]
        _refuse(answer.index >= len(names))
        answer.pixelformat = fourcc(names[answer.index])

    def _enum_sizes(self, camera, answer):
        name = answer.pixel_format.to_bytes(4, 'little').decode()
        if name in camera.span:
            _refuse(answer.index > 0)
            answer.type = 3
            (
                answer.size.stepwise.min_width,
                answer.size.stepwise.max_width,
                answer.size.stepwise.step_width,
                answer.size.stepwise.min_height,
                answer.size.stepwise.max_height,
                answer.size.stepwise.step_height,
            ) = camera.span[name]
            return
        sizes = list(camera.modes.get(name, ()))
        _refuse(answer.index >= len(sizes))
        answer.type = v4l2.FRMSIZE_DISCRETE
        answer.size.discrete.width, answer.size.discrete.height = sizes[answer.index]

    def _enum_intervals(self, camera, answer):
        name = answer.pixel_format.to_bytes(4, 'little').decode()
        rates = camera.modes.get(name, {}).get((answer.width, answer.height), ())
        _refuse(answer.index >= len(rates))
        answer.type = v4l2.FRMIVAL_DISCRETE
        answer.interval.discrete.numerator = 1
        answer.interval.discrete.denominator = rates[answer.index]

    def _g_fmt(self, camera, answer):
        name, width, height = camera.format
        pix = answer.fmt.pix
        pix.pixelformat, pix.width, pix.height = fourcc(name), width, height
        pix.bytesperline = 0 if name == 'MJPG' else 2 * width
        pix.sizeimage = self.buffer_size

    def _s_fmt(self, camera, answer):
        _refuse(camera.streaming, errno.EBUSY)
        wanted = answer.fmt.pix
        name = wanted.pixelformat.to_bytes(4, 'little').decode()
        if name not in camera.modes:
            name = next(iter(camera.modes))
        size = min(camera.modes[name], key=lambda one: abs(one[0] - wanted.width))
        camera.format = (name, *size)
        self._g_fmt(camera, answer)

    def _g_parm(self, camera, answer):
        interval = answer.parm.capture.timeperframe
        interval.numerator, interval.denominator = camera.rate

    def _s_parm(self, camera, answer):
        interval = answer.parm.capture.timeperframe
        wanted = interval.denominator / interval.numerator
        rates = camera.modes[camera.format[0]][camera.format[1:]] or (30,)
        camera.rate = (1, min(rates, key=lambda rate: abs(rate - wanted)))
        self._g_parm(camera, answer)

    def _reqbufs(self, camera, answer):
        _refuse(camera.streaming, errno.EBUSY)
        mapped = [one for one in camera.__dict__.get('memory', {}).values() if not one.closed]
        _refuse(bool(mapped) and answer.count == 0, errno.EBUSY)
        camera.buffers = answer.count
        camera.queued.clear()
        camera.__dict__['memory'] = {}

    def _querybuf(self, camera, answer):
        _refuse(answer.index >= camera.buffers)
        answer.length = self.buffer_size
        answer.m.offset = answer.index * self.buffer_size

    def _qbuf(self, camera, answer):
        _refuse(answer.index >= camera.buffers or answer.index in camera.queued)
        camera.queued.append(answer.index)

    def _dqbuf(self, camera, answer):
        _refuse(not camera.streaming)
        if not self._due(camera):
            raise BlockingIOError(errno.EAGAIN, 'nothing yet')
        frame = camera.frames.popleft()
        answer.index = camera.queued.popleft()
        answer.bytesused, answer.sequence = len(frame.data), frame.sequence
        answer.flags = frame.flags
        answer.timestamp.tv_sec = frame.stamp_ns // 1_000_000_000
        answer.timestamp.tv_usec = frame.stamp_ns % 1_000_000_000 // 1000
        memory = camera.__dict__['memory'][answer.index * self.buffer_size]
        with memoryview(memory) as view:
            view[: len(frame.data)] = frame.data

    def _streamon(self, camera, _):
        camera.streaming = True
        camera.began_ns, camera.taken = time.monotonic_ns(), 0
        camera.streams_started += 1

    def _streamoff(self, camera, _):
        camera.streaming = False
        camera.queued.clear()

    def _query_control(self, camera, answer):
        after = answer.id & ~v4l2.CTRL_FLAG_NEXT_CTRL
        later = [one for one in camera.controls if one.id > after]
        _refuse(not later)
        one = min(later, key=lambda control: control.id)
        answer.id, answer.type, answer.name = one.id, one.type, one.label.encode()
        answer.minimum, answer.maximum, answer.step = one.minimum, one.maximum, one.step
        answer.default_value = one.default if isinstance(one.default, int) else 0
        answer.flags = one.flags

    def _query_menu(self, camera, answer):
        (one,) = (one for one in camera.controls if one.id == answer.id)
        _refuse(answer.index not in one.menu)
        if one.type == v4l2.CTRL_TYPE_MENU:
            answer.item.name = one.menu[answer.index].encode()
        else:
            answer.item.value = one.menu[answer.index]

    def _get_control(self, camera, answer):
        one, entry = _entry(camera, answer)
        if one.type == v4l2.CTRL_TYPE_STRING:
            ctypes.memmove(entry.content.pointer, one.value.encode() + b'\0', len(one.value) + 1)
        elif one.type == v4l2.CTRL_TYPE_INTEGER64:
            entry.content.value64 = one.value
        else:
            entry.content.value = one.value

    def _set_control(self, camera, answer):
        one, entry = _entry(camera, answer)
        _refuse(bool(one.flags & v4l2.CTRL_FLAG_INACTIVE), errno.EACCES)
        if one.type == v4l2.CTRL_TYPE_STRING:
            one.value = ctypes.string_at(entry.content.pointer).decode()
        elif one.type == v4l2.CTRL_TYPE_INTEGER64:
            one.value = entry.content.value64
        else:
            one.value = entry.content.value


class FakeMapping(bytearray):
    """A mapping; like mmap, it cannot be closed while somebody looks into it."""

    def __init__(self, length):
        super().__init__(length)
        self.closed = False

    def close(self):
        self.append(0)  # raises BufferError while a memoryview is alive
        self.closed = True


def _entry(camera, answer):
    entry = answer.controls[0]
    (one,) = (one for one in camera.controls if one.id == entry.id)
    return one, entry


def _refuse(condition, code=errno.EINVAL):
    if condition:
        raise OSError(code, os.strerror(code))


_HANDLERS = {
    v4l2.VIDIOC_QUERYCAP: '_querycap',
    v4l2.VIDIOC_ENUM_FMT: '_enum_fmt',
    v4l2.VIDIOC_ENUM_FRAMESIZES: '_enum_sizes',
    v4l2.VIDIOC_ENUM_FRAMEINTERVALS: '_enum_intervals',
    v4l2.VIDIOC_G_FMT: '_g_fmt',
    v4l2.VIDIOC_S_FMT: '_s_fmt',
    v4l2.VIDIOC_G_PARM: '_g_parm',
    v4l2.VIDIOC_S_PARM: '_s_parm',
    v4l2.VIDIOC_REQBUFS: '_reqbufs',
    v4l2.VIDIOC_QUERYBUF: '_querybuf',
    v4l2.VIDIOC_QBUF: '_qbuf',
    v4l2.VIDIOC_DQBUF: '_dqbuf',
    v4l2.VIDIOC_STREAMON: '_streamon',
    v4l2.VIDIOC_STREAMOFF: '_streamoff',
    v4l2.VIDIOC_QUERY_EXT_CTRL: '_query_control',
    v4l2.VIDIOC_QUERYMENU: '_query_menu',
    v4l2.VIDIOC_G_EXT_CTRLS: '_get_control',
    v4l2.VIDIOC_S_EXT_CTRLS: '_set_control',
}
