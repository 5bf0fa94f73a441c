"""What cameras really do: the rates they reach and the skew of a pair, measured."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from binopos_ros.capture import usb
from binopos_ros.capture.formats import ENCODINGS, JPEG_FORMATS
from binopos_ros.capture.kernel import Kernel
from binopos_ros.capture.options import CaptureOptions
from binopos_ros.capture.rig import CaptureRig
from binopos_ros.capture.skew import Skew
from binopos_ros.capture.stream import Frame
from binopos_ros.capture.usb import Camera
from binopos_ros.capture.v4l2 import Device, Format, Mode


@dataclass(frozen=True)
class Reached:
    """One camera over the time of a survey. Rates are in 1/s.

    :ivar frame_bytes: of the largest frame.
    :ivar trouble: why there were no frames; '' where there were.
    """

    camera: Camera | None
    format: Format | None
    rate: float
    lost: int
    corrupt: int
    frame_bytes: int
    trouble: str


@dataclass(frozen=True)
class Survey:
    """The cameras of a rig over the time of a survey, by side, and their skew."""

    sides: dict[str, Reached]
    skew: Skew | None
    unpaired: int


def modes_of(camera: Camera) -> list[Mode]:
    """What a camera offers of what the suite can use.

    :raises CaptureError: where it cannot be opened, or is no camera.
    """
    with Device(camera.node) as device:
        modes = device.modes()
    usable = (*JPEG_FORMATS, *ENCODINGS)
    return [mode for mode in modes if mode.pixel_format in usable]


def survey(
    options: CaptureOptions,
    seconds: float,
    *,
    kernel: Kernel | None = None,
    look: Callable[[], list[Camera]] = usb.find_cameras,
) -> Survey:
    """Stream from the cameras of the rig for a while.

    :raises CaptureError: where the options cannot be met.
    """
    arrivals: dict[str, list[int]] = {}
    largest: dict[str, int] = {}

    def count(side: str, frame: Frame, form: Format) -> None:
        arrivals.setdefault(side, []).append(frame.stamp_ns)
        largest[side] = max(largest.get(side, 0), len(frame.data))

    rig = CaptureRig(options, count, {}, kernel=kernel, look=look)
    rig.check()
    rig.start()
    time.sleep(seconds)
    skew, unpaired = rig.meter.skew(), rig.meter.unpaired.total()
    healths = {side: camera.health for side, camera in rig.cameras.items()}
    troubles = {side: health.trouble for side, health in healths.items()}
    rig.stop()
    return Survey(
        {
            side: Reached(
                camera=health.camera,
                format=health.format,
                rate=_rate(arrivals.get(side, [])),
                lost=health.lost,
                corrupt=health.corrupt,
                frame_bytes=largest.get(side, 0),
                trouble=troubles[side],
            )
            for side, health in healths.items()
        },
        skew,
        unpaired,
    )


def _rate(stamps: list[int]) -> float:
    span = (stamps[-1] - stamps[0]) * 1e-9 if len(stamps) > 1 else 0.0
    return (len(stamps) - 1) / span if span > 0.0 else 0.0
