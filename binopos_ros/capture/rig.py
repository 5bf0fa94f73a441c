"""The cameras of the rig at work: a thread each, kept alike, their skew measured."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from contextlib import closing

from binopos_ros.capture import usb
from binopos_ros.capture.errors import INVALID, CaptureError
from binopos_ros.capture.identity import Identity
from binopos_ros.capture.kernel import Kernel
from binopos_ros.capture.options import CaptureOptions
from binopos_ros.capture.recovery import STREAMING, SteadyCamera
from binopos_ros.capture.skew import SkewMeter
from binopos_ros.capture.stream import Frame
from binopos_ros.capture.usb import Camera
from binopos_ros.capture.v4l2 import Format
from binopos_ros.sides import SIDES

LOCKED_VALUES = ('exposure_time_absolute', 'exposure_absolute', 'exposure', 'gain')
AUTOMATICS = {'auto_exposure': 1, 'exposure_auto': 1, 'gain_automatic': 0}
"""Controls that let a camera choose its exposure by itself -> the value that stops it."""

BOTH = 'both'

_log = logging.getLogger(__name__)

Settings = Mapping[str, dict[str, 'int | str']]


class CaptureRig:
    """Two cameras, or one that sends both views ('both').

    :param on_frame: takes a side, a good frame and its format, in that camera's thread.
    :param settings: values of controls by side.
    :ivar cameras: by side; 'both' alone where one camera sends both views.
    """

    def __init__(
        self,
        options: CaptureOptions,
        on_frame: Callable[[str, Frame, Format], None],
        settings: Settings,
        *,
        kernel: Kernel | None = None,
        look: Callable[[], list[Camera]] = usb.find_cameras,
    ) -> None:
        self._on_frame = on_frame
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self.meter = SkewMeter(options.tolerance(0.0))
        names = (
            {BOTH: options.left.device}
            if options.side_by_side
            else {
                'left': options.left.device,
                'right': options.right.device,
            }
        )
        self.cameras = {
            side: SteadyCamera(
                name,
                options.wanted,
                controls=settings.get(side),
                others=lambda side=side: self._others(side),  # type: ignore[misc]
                kernel=kernel,
                look=look,
            )
            for side, name in names.items()
        }

    def check(self) -> dict[str, CaptureError]:
        """Open each camera once; give by side why one cannot be used yet.

        :raises CaptureError: where something is wrong that will not mend itself.
        """
        troubles = {}
        for side, camera in self.cameras.items():
            try:
                camera.check()
            except CaptureError as error:
                if error.cause == INVALID:
                    raise
                camera.health.trouble = str(error)
                troubles[side] = error
        return troubles

    @property
    def running(self) -> bool:
        """Whether the cameras are being read."""
        return bool(self._threads)

    def start(self) -> None:
        """Read the cameras, each in a thread; nothing where they are read already."""
        if self._threads:
            return
        for camera in self.cameras.values():
            camera.resume()
        self._threads = [
            threading.Thread(target=self._work, args=(side,), name=f'camera {side}', daemon=True)
            for side in self.cameras
        ]
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Stop reading, and close the cameras."""
        for camera in self.cameras.values():
            camera.stop()
        for thread in self._threads:
            thread.join()
        self._threads = []
        with self._lock:
            self.meter.forget()

    def identities(self) -> dict[str, Identity]:
        """Who left and right are, as far as they have been seen."""
        return {
            side: camera.identity
            for side, camera in self.cameras.items()
            if camera.identity is not None
        }

    def equalise(self) -> str:
        """Give the right camera the left one's exposure and gain; why not, or ''."""
        left, right = (self.cameras.get(side) for side in SIDES)
        if left is None or right is None:
            return ''
        if any(camera.health.state != STREAMING for camera in (left, right)):
            return ''
        try:
            for name, manual in AUTOMATICS.items():
                if name in right.controls and right.get_control(name) != manual:
                    right.set_control(name, manual)
            for name in LOCKED_VALUES:
                if name in left.controls and name in right.controls:
                    value = left.get_control(name)
                    if value is not None and value != right.get_control(name):
                        right.set_control(name, value)
        except CaptureError as error:
            return f'exposure not locked: {error}'
        return ''

    def _others(self, side: str) -> list[Identity]:
        return [identity for other, identity in self.identities().items() if other != side]

    def _work(self, side: str) -> None:
        camera = self.cameras[side]
        while not camera.stopped:
            try:
                with closing(camera.frames()) as frames:
                    for frame in frames:
                        if side in SIDES:
                            with self._lock:
                                self.meter.add(side, frame.stamp_ns)
                        assert camera.health.format is not None
                        self._on_frame(side, frame, camera.health.format)
            except Exception as error:
                # A bug must neither be told as streaming nor cost the camera for good.
                _log.exception('camera %s', side)
                camera.give_up(f'a bug: {error!r}; opening it again')
