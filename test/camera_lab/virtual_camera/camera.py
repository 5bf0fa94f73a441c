"""The virtual camera itself: answers requests, streams JPEGs by the clock, fails when told to."""

from __future__ import annotations

import os
import struct
import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from virtual_camera import descriptors, usbip
from virtual_camera.usbip import EPIPE, Link, Transfer, Unlink

_SET_CUR, _GET_CUR, _GET_MIN, _GET_MAX, _GET_RES, _GET_LEN, _GET_INFO, _GET_DEF = (
    0x01,
    0x81,
    0x82,
    0x83,
    0x84,
    0x85,
    0x86,
    0x87,
)
_PROBE, _COMMIT = 1, 2
_GAIN = 4
_ERROR_CODE, _INVALID_CONTROL = 2, b'\x06'
_READ_AND_WRITE = b'\x03'
_CLASS_REQUEST = 0x20
_FRAME_ID, _END_OF_FRAME, _ERROR, _END_OF_HEADER = 0x01, 0x02, 0x40, 0x80

FAULTS = ('corrupt', 'short', 'error', 'drop', 'stall')
"""A JPEG of noise inside, one cut short, one flagged by the device, none, a halted endpoint."""


@dataclass
class _Control:
    size: int
    minimum: int
    maximum: int
    resolution: int
    default: int
    value: int


def _controls() -> dict[tuple[int, int], _Control]:
    terminal, unit = descriptors.CAMERA_TERMINAL, descriptors.PROCESSING_UNIT
    return {
        (terminal, 2): _Control(1, 1, 8, 0b1001, 8, 8),  # auto exposure: manual or by aperture
        (terminal, 4): _Control(4, 1, 5000, 1, 166, 166),  # exposure time
        (unit, 2): _Control(2, -64, 64, 1, 0, 0),  # brightness
        (unit, 3): _Control(2, 0, 95, 1, 32, 32),  # contrast
        (unit, _GAIN): _Control(2, 0, 100, 1, 0, 0),
    }


class VirtualCamera:
    """A camera that shows `frames` one after the other, by the machine's clock.

    Two cameras on one clock show the frame of the same number at the same time.

    :param frames: JPEGs of one size.
    :ivar faults: how many of the next frames to spoil, by the kinds in `FAULTS`.
    :ivar sent: how many frames it has sent to the end.
    :ivar frozen: while True it sends nothing, and says nothing.
    """

    def __init__(
        self,
        frames: Sequence[bytes],
        size: tuple[int, int],
        rates: tuple[int, ...],
        serial: str,
        *,
        vendor: int = 0x1209,
        product: int = 0x0001,
        name: str = 'Virtual camera',
    ) -> None:
        self.frames = frames
        self.size = size
        self.rates = rates
        self.serial = serial
        self.faults: Counter[str] = Counter()
        self.sent = 0
        self.frozen = False
        self._device = descriptors.device(vendor, product)
        self._configuration = descriptors.configuration(*size, rates)
        self._strings = [
            descriptors.languages(),
            *(descriptors.string(text) for text in ('binopos', name, serial)),
        ]
        self._session: _Session | None = None

    @property
    def gain(self) -> int | None:
        """The gain that the host has set; None while it is unplugged."""
        return self._session.gain if self._session else None

    @property
    def port(self) -> int | None:
        """The port that it is plugged into."""
        return self._session.link.port if self._session else None

    def plug(self, port: int | None = None) -> None:
        """Plug it in, by default into the first free port."""
        self._session = _Session(self, usbip.plug(port))

    def unplug(self) -> None:
        """Pull it out."""
        if self._session is not None:
            self._session.end()
            self._session = None

    def descriptor(self, kind: int, index: int) -> bytes | None:
        """The descriptor that the host asks for; None where there is none."""
        if kind == 3:
            return self._strings[index] if index < len(self._strings) else None
        return {1: self._device, 2: self._configuration, 6: descriptors.qualifier()}.get(kind)

    def spoil(self, kind: str) -> bool:
        """Whether this frame is to fail in this way."""
        if self.faults[kind] <= 0:
            return False
        self.faults[kind] -= 1
        return True


class _Session:
    """The camera while it is plugged in: a thread that answers, and one that streams."""

    def __init__(self, camera: VirtualCamera, link: Link) -> None:
        self.link = link
        self._camera = camera
        self._controls = _controls()
        self._probe = self._commit = self._negotiated(0)
        self._waiting: OrderedDict[int, Transfer] = OrderedDict()
        self._changed = threading.Condition()
        self._alive = True
        self._stream = 0
        for work in (self._answer, self._send_frames):
            threading.Thread(target=work, daemon=True).start()

    @property
    def gain(self) -> int:
        return self._controls[descriptors.PROCESSING_UNIT, _GAIN].value

    def end(self) -> None:
        with self._changed:
            self._alive = False
            self._changed.notify_all()
        self.link.close()

    def _answer(self) -> None:
        try:
            while self._alive:
                request = self.link.receive()
                if isinstance(request, Unlink):
                    with self._changed:
                        in_time = self._waiting.pop(request.victim, None) is not None
                        self._stream += 1
                        self._changed.notify_all()
                    self.link.unlinked(request, in_time)
                elif request.endpoint == descriptors.ENDPOINT:
                    with self._changed:
                        self._waiting[request.number] = request
                        self._changed.notify_all()
                else:
                    answer = self._control(request)
                    if answer is None:
                        self.link.complete(request, status=-EPIPE)
                    else:
                        self.link.complete(request, answer[: request.length])
        except (EOFError, OSError):
            self.end()

    def _control(self, request: Transfer) -> bytes | None:
        kind, code, value, index, _ = struct.unpack('<BBHHH', request.setup)
        if kind & 0x60 == 0:
            if code == 6:
                return self._camera.descriptor(value >> 8, value & 0xFF)
            return {0: b'\0\0', 8: b'\1', 10: b'\0'}.get(code, b'')
        if kind & 0x60 != _CLASS_REQUEST:
            return None
        selector, entity, interface = value >> 8, index >> 8, index & 0xFF
        if interface == descriptors.STREAMING_INTERFACE:
            return self._streaming_control(selector, code, request.data)
        if entity == 0:
            return _INVALID_CONTROL if (selector, code) == (_ERROR_CODE, _GET_CUR) else None
        control = self._controls.get((entity, selector))
        return _answer_control(control, code, request.data) if control else None

    def _streaming_control(self, selector: int, code: int, data: bytes) -> bytes | None:
        if selector not in (_PROBE, _COMMIT):
            return None
        if code == _SET_CUR:
            self._probe = self._negotiated(struct.unpack_from('<I', data, 4)[0])
            if selector == _COMMIT:
                self._commit = self._probe
            return b''
        if code == _GET_LEN:
            return struct.pack('<H', len(self._probe))
        if code == _GET_INFO:
            return _READ_AND_WRITE
        return self._probe if selector == _PROBE else self._commit

    def _negotiated(self, interval: int) -> bytes:
        offered = [descriptors.interval(rate) for rate in self._camera.rates]
        chosen = min(offered, key=lambda each: abs(each - interval)) if interval else offered[0]
        width, height = self._camera.size
        return struct.pack('<HBBI10xII', 1, 1, 1, chosen, 2 * width * height, descriptors.PAYLOAD)

    def _send_frames(self) -> None:
        toggle = 0
        while self._wait(lambda: bool(self._waiting)):
            stream = self._stream
            interval = struct.unpack_from('<I', self._commit, 4)[0] / descriptors.TICKS_PER_SECOND
            number = int(time.monotonic() / interval) + 1
            time.sleep(max(0.0, number * interval - time.monotonic()))
            # On a busy machine it is later by now than it should be.
            number = round(time.monotonic() / interval)
            camera = self._camera
            if camera.frozen or camera.spoil('drop'):
                continue
            picture, flags = _spoiled(camera, camera.frames[number % len(camera.frames)])
            toggle ^= _FRAME_ID
            try:
                self._send_frame(picture, flags | toggle, stream)
            except OSError:
                return

    def _send_frame(self, picture: bytes, flags: int, stream: int) -> None:
        sent = 0
        while sent < len(picture):
            transfer = self._next_transfer(stream)
            if transfer is None:
                return
            if self._camera.spoil('stall'):
                self.link.complete(transfer, status=-EPIPE)
                continue
            room = min(transfer.length, descriptors.PAYLOAD) - 2
            part = picture[sent : sent + room]
            sent += len(part)
            last = _END_OF_FRAME if sent == len(picture) else 0
            self.link.complete(transfer, bytes([2, _END_OF_HEADER | flags | last]) + part)
        self._camera.sent += 1

    def _next_transfer(self, stream: int) -> Transfer | None:
        if not self._wait(lambda: bool(self._waiting) or self._stream != stream):
            return None
        with self._changed:
            # The host has stopped the stream: what was begun is not finished.
            if self._stream != stream or not self._waiting:
                return None
            return self._waiting.popitem(last=False)[1]

    def _wait(self, condition: Callable[[], bool]) -> bool:
        with self._changed:
            self._changed.wait_for(lambda: not self._alive or condition())
            return self._alive


def _answer_control(control: _Control, code: int, data: bytes) -> bytes | None:
    if code == _SET_CUR:
        signed = control.minimum < 0
        control.value = int.from_bytes(data[: control.size], 'little', signed=signed)
        return b''
    if code == _GET_LEN:
        return struct.pack('<H', control.size)
    if code == _GET_INFO:
        return _READ_AND_WRITE
    values = {
        _GET_CUR: control.value,
        _GET_MIN: control.minimum,
        _GET_MAX: control.maximum,
        _GET_RES: control.resolution,
        _GET_DEF: control.default,
    }
    if code not in values:
        return None
    return (values[code] & ((1 << 8 * control.size) - 1)).to_bytes(control.size, 'little')


def _spoiled(camera: VirtualCamera, picture: bytes) -> tuple[bytes, int]:
    if camera.spoil('corrupt'):
        third = len(picture) // 3
        picture = picture[:third] + os.urandom(third) + picture[2 * third :]
    if camera.spoil('short'):
        picture = picture[: len(picture) // 2]
    return picture, _ERROR if camera.spoil('error') else 0
