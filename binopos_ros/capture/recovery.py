"""A camera that comes back: frames without end, whatever happens to the device.

    closed -> open -> streaming -> lost -> (a pause) -> open -> ...

Losing a camera (unplugged, frozen, busy, broken) is an everyday event here, not an exception: it
is told by `health`, and the same camera is opened again wherever it turns up. Pauses between the
tries grow, and begin small again once it has streamed for a while.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from binopos_ros.capture import usb
from binopos_ros.capture.controls import Control, in_order_of_setting
from binopos_ros.capture.errors import FAILED, FROZEN, GONE, CaptureError
from binopos_ros.capture.identity import Identity, find_again
from binopos_ros.capture.kernel import Kernel
from binopos_ros.capture.options import Wanted
from binopos_ros.capture.stream import Frame
from binopos_ros.capture.usb import Camera
from binopos_ros.capture.v4l2 import Device, Format

CLOSED, WAITING, STREAMING, LOST = STATES = ('closed', 'waiting', 'streaming', 'lost')

FIRST_PAUSE = 0.1
LONGEST_PAUSE = 1.0
LONGEST_SHORT_PAUSE = 0.4
"""While a camera is absent, which is seen in sysfs at next to no cost, and after a freeze, which
has taken its time already."""
STEADY = 5.0
"""Seconds of streaming after which the next loss begins with the smallest pause again."""
FAILURES_BEFORE_RESET = 3


@dataclass
class Health:
    """How a camera fares, for diagnostics.

    :ivar trouble: what is wrong, in one line; '' while it streams.
    :ivar notice: something to know though it streams ('moved to another port'); '' if nothing.
    :ivar good: frames handed on; `lost`: left out by the driver; `corrupt`: dropped as damaged.
    :ivar losses: how often the camera was lost, by cause.
    :ivar outage: s from the last loss to the first good frame after it.
    :ivar recovery: s from when the camera was seen again to that frame.
    """

    state: str = CLOSED
    trouble: str = ''
    notice: str = ''
    good: int = 0
    lost: int = 0
    corrupt: int = 0
    losses: Counter[str] = field(default_factory=Counter)
    resets: int = 0
    outage: float = 0.0
    recovery: float = 0.0
    format: Format | None = None
    camera: Camera | None = None


class Pauses:
    """How long to wait before the next try: twice as long after each that failed."""

    def __init__(self) -> None:
        self._next = FIRST_PAUSE

    def after(self, cause: str, lasted: float) -> float:
        """The pause (s) after a loss, the camera having been open for `lasted` s."""
        if lasted > STEADY:
            self._next = FIRST_PAUSE
        longest = LONGEST_SHORT_PAUSE if cause in (GONE, FROZEN) else LONGEST_PAUSE
        pause = min(self._next, longest)
        self._next = min(2.0 * self._next, LONGEST_PAUSE)
        return pause


class SteadyCamera:
    """Opens a camera by name, streams from it, and opens it again when it is lost.

    :param name: as `usb.choose` takes it.
    :param controls: values to set each time it is opened, by the control's name.
    :param others: the identities of the other cameras of this process.
    """

    def __init__(
        self,
        name: str,
        wanted: Wanted,
        *,
        controls: dict[str, int | str] | None = None,
        others: Callable[[], Iterable[Identity]] = tuple,
        kernel: Kernel | None = None,
        look: Callable[[], list[Camera]] = usb.find_cameras,
        reset: Callable[[Camera], None] = usb.reset,
    ) -> None:
        self.name = name
        self.wanted = wanted
        self.health = Health()
        self.identity: Identity | None = None
        self.controls: dict[str, Control] = {}
        self._settings = dict(controls or {})
        self._others = others
        self._kernel = kernel
        self._look = look
        self._reset = reset
        self._device: Device | None = None
        self._lock = threading.RLock()
        self._stopping = threading.Event()
        self._lost_at: float | None = None
        self._seen_at: float | None = None
        self._failures = 0

    def check(self) -> None:
        """Open the camera and set it up once, to know at the start whether that is possible.

        :raises CaptureError: as opening does; a cause of `INVALID` will not mend itself.
        """
        with self._opened():
            pass

    def frames(self) -> Generator[Frame, None, None]:
        """Yield good frames until `stop`, over every loss of the camera.

        A frame's bytes are valid until the next one is asked for.
        """
        pauses = Pauses()
        while not self._stopping.is_set():
            began = time.monotonic()
            try:
                with self._opened() as device:
                    yield from self._stream(device)
            except CaptureError as error:
                self._note_loss(error)
                self._stopping.wait(pauses.after(error.cause, time.monotonic() - began))
        self.health.state = CLOSED

    def give_up(self, trouble: str) -> None:
        """Tell of a trouble that is not the camera's, and pause before it is opened again."""
        self.health.state, self.health.trouble = LOST, trouble
        self._stopping.wait(LONGEST_PAUSE)

    @property
    def stopped(self) -> bool:
        """Whether `frames` has been told to end."""
        return self._stopping.is_set()

    def stop(self) -> None:
        """End `frames` within a tenth of a second, now and until `resume`."""
        self._stopping.set()

    def resume(self) -> None:
        """Let `frames` begin again after a stop."""
        self._stopping.clear()

    def set_control(self, name: str, value: int | str) -> None:
        """Set a control now, if the camera is there, and whenever it is opened.

        :raises CaptureError: where the camera refuses; then the value is not kept.
        """
        with self._lock:
            if self._device is not None:
                self._device.set(name, value)
            self._settings[name] = value

    def leave_control(self, name: str) -> None:
        """Set a control no more when the camera is opened."""
        with self._lock:
            self._settings.pop(name, None)

    def get_control(self, name: str) -> int | str | None:
        """Read a control; None while the camera is not there.

        :raises CaptureError: where it has no such control.
        """
        with self._lock:
            return self._device.get(name) if self._device is not None else None

    @contextmanager
    def _opened(self) -> Iterator[Device]:
        camera = self._find()
        device = Device(camera.node, self._kernel)
        try:
            with self._lock:
                self._device, self.controls = device, device.controls
                self.health.camera = camera
                wanted = self.wanted
                self.health.format = device.set_format(
                    wanted.pixel_format, wanted.width, wanted.height, wanted.frame_rate
                )
                for name in in_order_of_setting(device.controls, list(self._settings)):
                    device.set(name, self._settings[name])
            yield device
        finally:
            with self._lock:
                self._device = None
                device.close()

    def _find(self) -> Camera:
        cameras = self._look()
        others = list(self._others())
        if self.identity is None:
            camera = usb.choose(self.name, cameras)
            if any(other.claims(camera) for other in others):
                message = (
                    f'camera {self.name!r} is {camera}, which the other side has: '
                    'name two cameras in left.device and right.device'
                )
                raise CaptureError(message)
        else:
            again = find_again(self.identity, cameras, others)
            if again is None:
                raise CaptureError(self._absent(cameras), GONE)
            camera = again
            if camera.port != self.identity.port:
                self.health.notice = f'moved from USB port {self.identity.port} to {camera.port}'
        if self._seen_at is None:
            self._seen_at = time.monotonic()
        self.identity = Identity.of(camera)
        return camera

    def _absent(self, cameras: list[Camera]) -> str:
        assert self.identity is not None
        message = f'camera {self.name!r} ({self.health.camera}) is unplugged; plug it in again'
        if not self.identity.port:
            return message
        instead = next((one for one in cameras if one.port == self.identity.port), None)
        if instead is None:
            return message
        return f'{message}, where there is {instead} now: have left and right been exchanged?'

    def _stream(self, device: Device) -> Iterator[Frame]:
        timeout = self.wanted.frame_timeout
        with device.stream(timeout=timeout, interrupted=self._stopping.is_set) as stream:
            good_at = time.monotonic()
            for frame in stream:
                self.health.lost += frame.lost
                if not frame.corrupt and len(frame.data):
                    good_at = time.monotonic()
                    self._note_good()
                    yield frame
                    continue
                self.health.corrupt += 1
                if time.monotonic() - good_at > timeout:
                    message = f'{device.path}: only damaged frames for {timeout:g} s'
                    raise CaptureError(message, FROZEN)

    def _note_good(self) -> None:
        health = self.health
        health.good += 1
        if health.state == STREAMING:
            return
        now = time.monotonic()
        if self._lost_at is not None:
            health.outage = now - self._lost_at
            health.recovery = now - (self._seen_at or now)
        self._lost_at = None
        self._failures = 0
        health.state, health.trouble = STREAMING, ''

    def _note_loss(self, error: CaptureError) -> None:
        health = self.health
        if health.state == STREAMING:
            health.losses[error.cause] += 1
            self._lost_at = time.monotonic()
            health.notice = ''
        if health.state == STREAMING or error.cause == GONE:
            self._seen_at = None
        health.state = LOST if health.good else WAITING
        health.trouble = str(error)
        self._failures = self._failures + 1 if error.cause in (FROZEN, FAILED) else 0
        if self.wanted.usb_reset and self._failures >= FAILURES_BEFORE_RESET:
            self._failures = 0
            self._try_reset()

    def _try_reset(self) -> None:
        assert self.health.camera is not None
        try:
            self._reset(self.health.camera)
            self.health.resets += 1
        except CaptureError as error:
            self.health.trouble = str(error)
