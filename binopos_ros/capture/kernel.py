"""The kernel's side of V4L2: structures, request numbers, and the four calls that reach it.

Everything here mirrors the kernel's public interface as documented in its "Video for Linux API"
(linux/videodev2.h), for 64-bit Linux: x86-64 and aarch64 share both the sizes of the structures
and the numbering of the requests. `SIZES` and the `VIDIOC_*` numbers are what a C compiler says
of the kernel's own header; the structures are checked against them.

`Kernel` is the seam at which tests put a camera of their own.
"""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os
import select
from typing import Any, Protocol

u8 = ctypes.c_uint8
u32 = ctypes.c_uint32
s32 = ctypes.c_int32
u64 = ctypes.c_uint64
s64 = ctypes.c_int64

CAP_VIDEO_CAPTURE = 0x00000001
CAP_VIDEO_CAPTURE_MPLANE = 0x00001000
CAP_META_CAPTURE = 0x00800000
CAP_STREAMING = 0x04000000
CAP_DEVICE_CAPS = 0x80000000

BUF_TYPE_VIDEO_CAPTURE = 1
MEMORY_MMAP = 1
FIELD_NONE = 1

BUF_FLAG_ERROR = 0x00000040
BUF_FLAG_TIMESTAMP_MASK = 0x0000E000
BUF_FLAG_TIMESTAMP_MONOTONIC = 0x00002000

FRMSIZE_DISCRETE = 1
FRMIVAL_DISCRETE = 1

CTRL_TYPE_INTEGER = 1
CTRL_TYPE_BOOLEAN = 2
CTRL_TYPE_MENU = 3
CTRL_TYPE_BUTTON = 4
CTRL_TYPE_INTEGER64 = 5
CTRL_TYPE_CTRL_CLASS = 6
CTRL_TYPE_STRING = 7
CTRL_TYPE_BITMASK = 8
CTRL_TYPE_INTEGER_MENU = 9
CTRL_COMPOUND_TYPES = 0x0100

CTRL_FLAG_DISABLED = 0x0001
CTRL_FLAG_READ_ONLY = 0x0004
CTRL_FLAG_INACTIVE = 0x0010
CTRL_FLAG_WRITE_ONLY = 0x0040
CTRL_FLAG_NEXT_CTRL = 0x80000000

VIDIOC_QUERYCAP = 0x80685600
VIDIOC_ENUM_FMT = 0xC0405602
VIDIOC_G_FMT = 0xC0D05604
VIDIOC_S_FMT = 0xC0D05605
VIDIOC_REQBUFS = 0xC0145608
VIDIOC_QUERYBUF = 0xC0585609
VIDIOC_QBUF = 0xC058560F
VIDIOC_DQBUF = 0xC0585611
VIDIOC_STREAMON = 0x40045612
VIDIOC_STREAMOFF = 0x40045613
VIDIOC_G_PARM = 0xC0CC5615
VIDIOC_S_PARM = 0xC0CC5616
VIDIOC_QUERYMENU = 0xC02C5625
VIDIOC_G_EXT_CTRLS = 0xC0205647
VIDIOC_S_EXT_CTRLS = 0xC0205648
VIDIOC_ENUM_FRAMESIZES = 0xC02C564A
VIDIOC_ENUM_FRAMEINTERVALS = 0xC034564B
VIDIOC_QUERY_EXT_CTRL = 0xC0E85667


class Capability(ctypes.Structure):
    _fields_ = (
        ('driver', ctypes.c_char * 16),
        ('card', ctypes.c_char * 32),
        ('bus_info', ctypes.c_char * 32),
        ('version', u32),
        ('capabilities', u32),
        ('device_caps', u32),
        ('reserved', u32 * 3),
    )


class FormatDescription(ctypes.Structure):
    _fields_ = (
        ('index', u32),
        ('type', u32),
        ('flags', u32),
        ('description', ctypes.c_char * 32),
        ('pixelformat', u32),
        ('mbus_code', u32),
        ('reserved', u32 * 3),
    )


class Fraction(ctypes.Structure):
    _fields_ = (('numerator', u32), ('denominator', u32))


class FrameSizeDiscrete(ctypes.Structure):
    _fields_ = (('width', u32), ('height', u32))


class FrameSizeStepwise(ctypes.Structure):
    _fields_ = (
        ('min_width', u32),
        ('max_width', u32),
        ('step_width', u32),
        ('min_height', u32),
        ('max_height', u32),
        ('step_height', u32),
    )


class _FrameSizeUnion(ctypes.Union):
    _fields_ = (('discrete', FrameSizeDiscrete), ('stepwise', FrameSizeStepwise))


class FrameSizeEnumeration(ctypes.Structure):
    _fields_ = (
        ('index', u32),
        ('pixel_format', u32),
        ('type', u32),
        ('size', _FrameSizeUnion),
        ('reserved', u32 * 2),
    )


class FrameIntervalStepwise(ctypes.Structure):
    _fields_ = (('min', Fraction), ('max', Fraction), ('step', Fraction))


class _FrameIntervalUnion(ctypes.Union):
    _fields_ = (('discrete', Fraction), ('stepwise', FrameIntervalStepwise))


class FrameIntervalEnumeration(ctypes.Structure):
    _fields_ = (
        ('index', u32),
        ('pixel_format', u32),
        ('width', u32),
        ('height', u32),
        ('type', u32),
        ('interval', _FrameIntervalUnion),
        ('reserved', u32 * 2),
    )


class PixelFormat(ctypes.Structure):
    _fields_ = (
        ('width', u32),
        ('height', u32),
        ('pixelformat', u32),
        ('field', u32),
        ('bytesperline', u32),
        ('sizeimage', u32),
        ('colorspace', u32),
        ('priv', u32),
        ('flags', u32),
        ('ycbcr_enc', u32),
        ('quantization', u32),
        ('xfer_func', u32),
    )


class _FormatUnion(ctypes.Union):
    # The kernel's union also holds pointers, which align it to eight bytes.
    _fields_ = (('pix', PixelFormat), ('raw', u8 * 200), ('alignment', u64))


class Format(ctypes.Structure):
    _fields_ = (('type', u32), ('fmt', _FormatUnion))


class RequestBuffers(ctypes.Structure):
    _fields_ = (
        ('count', u32),
        ('type', u32),
        ('memory', u32),
        ('capabilities', u32),
        ('flags', u8),
        ('reserved', u8 * 3),
    )


class TimeVal(ctypes.Structure):
    _fields_ = (('tv_sec', s64), ('tv_usec', s64))


class TimeCode(ctypes.Structure):
    _fields_ = (
        ('type', u32),
        ('flags', u32),
        ('frames', u8),
        ('seconds', u8),
        ('minutes', u8),
        ('hours', u8),
        ('userbits', u8 * 4),
    )


class _BufferMemory(ctypes.Union):
    _fields_ = (('offset', u32), ('userptr', u64))


class Buffer(ctypes.Structure):
    _fields_ = (
        ('index', u32),
        ('type', u32),
        ('bytesused', u32),
        ('flags', u32),
        ('field', u32),
        ('timestamp', TimeVal),
        ('timecode', TimeCode),
        ('sequence', u32),
        ('memory', u32),
        ('m', _BufferMemory),
        ('length', u32),
        ('reserved2', u32),
        ('request_fd', s32),
    )


class CaptureParameters(ctypes.Structure):
    _fields_ = (
        ('capability', u32),
        ('capturemode', u32),
        ('timeperframe', Fraction),
        ('extendedmode', u32),
        ('readbuffers', u32),
        ('reserved', u32 * 4),
    )


class _StreamUnion(ctypes.Union):
    _fields_ = (('capture', CaptureParameters), ('raw', u8 * 200))


class StreamParameters(ctypes.Structure):
    _fields_ = (('type', u32), ('parm', _StreamUnion))


class QueryExtendedControl(ctypes.Structure):
    _fields_ = (
        ('id', u32),
        ('type', u32),
        ('name', ctypes.c_char * 32),
        ('minimum', s64),
        ('maximum', s64),
        ('step', u64),
        ('default_value', s64),
        ('flags', u32),
        ('elem_size', u32),
        ('elems', u32),
        ('nr_of_dims', u32),
        ('dims', u32 * 4),
        ('reserved', u32 * 32),
    )


class _MenuUnion(ctypes.Union):
    _pack_ = 1
    _fields_ = (('name', ctypes.c_char * 32), ('value', s64))


class QueryMenu(ctypes.Structure):
    _pack_ = 1
    _fields_ = (('id', u32), ('index', u32), ('item', _MenuUnion), ('reserved', u32))


class _ControlUnion(ctypes.Union):
    _pack_ = 1
    _fields_ = (('value', s32), ('value64', s64), ('pointer', ctypes.c_void_p))


class ExtendedControl(ctypes.Structure):
    _pack_ = 1
    _fields_ = (('id', u32), ('size', u32), ('reserved2', u32), ('content', _ControlUnion))


class ExtendedControls(ctypes.Structure):
    _fields_ = (
        ('which', u32),
        ('count', u32),
        ('error_idx', u32),
        ('request_fd', s32),
        ('reserved', u32),
        ('controls', ctypes.POINTER(ExtendedControl)),
    )


SIZES = {
    Capability: ('v4l2_capability', 104),
    FormatDescription: ('v4l2_fmtdesc', 64),
    FrameSizeEnumeration: ('v4l2_frmsizeenum', 44),
    FrameIntervalEnumeration: ('v4l2_frmivalenum', 52),
    PixelFormat: ('v4l2_pix_format', 48),
    Format: ('v4l2_format', 208),
    RequestBuffers: ('v4l2_requestbuffers', 20),
    Buffer: ('v4l2_buffer', 88),
    CaptureParameters: ('v4l2_captureparm', 40),
    StreamParameters: ('v4l2_streamparm', 204),
    QueryExtendedControl: ('v4l2_query_ext_ctrl', 232),
    QueryMenu: ('v4l2_querymenu', 44),
    ExtendedControl: ('v4l2_ext_control', 20),
    ExtendedControls: ('v4l2_ext_controls', 32),
}
"""The name in linux/videodev2.h and the size in bytes of every structure above."""


class Kernel(Protocol):
    """The calls that this room makes; all but `poll` raise OSError as the kernel says."""

    def open(self, path: str) -> int:
        """Open a device node for reading and writing, without blocking; a file descriptor."""

    def close(self, descriptor: int) -> None:
        """Give the file descriptor back."""

    def ioctl(self, descriptor: int, request: int, argument: ctypes.Structure | u32) -> None:
        """Make the request; the kernel writes its answer into the argument."""

    def map(self, descriptor: int, length: int, offset: int) -> Any:
        """Map a driver's buffer; an object with the buffer protocol and `close()`."""

    def poll(self, descriptor: int, timeout: float) -> bool:
        """Wait up to `timeout` seconds until there is something to be had (an error too)."""


class Linux:
    """The kernel of the machine."""

    def open(self, path: str) -> int:
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, descriptor: int) -> None:
        os.close(descriptor)

    def ioctl(self, descriptor: int, request: int, argument: ctypes.Structure | u32) -> None:
        fcntl.ioctl(descriptor, request, argument)  # type: ignore[call-overload]

    def map(self, descriptor: int, length: int, offset: int) -> Any:
        return mmap.mmap(
            descriptor, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset
        )

    def poll(self, descriptor: int, timeout: float) -> bool:
        poller = select.poll()
        poller.register(descriptor, select.POLLIN | select.POLLPRI)
        return bool(poller.poll(max(0.0, timeout) * 1000.0))
