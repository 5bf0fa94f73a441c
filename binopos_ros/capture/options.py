"""The cameras' options; the camera node declares its ROS parameters from them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.formats import known_format
from binopos_ros.capture.recovery import Wanted


def _fixed(default: Any, description: str, unit: str = '', **more: Any) -> Any:
    return _option(default, description, unit, read_only=True, **more)


def _option(default: Any, description: str, unit: str = '', **more: Any) -> Any:
    return field(default=default, metadata={'description': description, 'unit': unit, **more})


@dataclass(frozen=True)
class LeftOptions:
    """The left camera."""

    device: str = _fixed(
        '/dev/video0',
        'Camera by its serial number, model (1209:0001), USB port (3-1.2), link below '
        '/dev/v4l/by-id or by-path, or node',
    )
    frame_id: str = _fixed('left_camera_optical_frame', 'Frame of the images')
    camera_info_url: str = _fixed('', 'Calibration: file://, package:// or a path')


@dataclass(frozen=True)
class RightOptions:
    """The right camera."""

    device: str = _fixed('/dev/video2', 'As left.device')
    frame_id: str = _fixed('right_camera_optical_frame', 'Frame of the images')
    camera_info_url: str = _fixed('', 'Calibration: file://, package:// or a path')


@dataclass(frozen=True)
class CaptureOptions:
    """The cameras of the rig and how to set them up.

    :raises CaptureError: where a value is out of its range or does not fit the others.
    """

    left: LeftOptions = field(default_factory=LeftOptions)
    right: RightOptions = field(default_factory=RightOptions)
    side_by_side: bool = _fixed(
        False, 'left.device sends both views in one image, the left one on its left'
    )
    pixel_format: str = _fixed('MJPG', "Four letters as the driver's: MJPG is passed through")
    width: int = _fixed(1280, 'Of the image as the camera sends it', 'px', range=(1, 16384))
    height: int = _fixed(720, 'Of the image as the camera sends it', 'px', range=(1, 16384))
    frame_rate: float = _fixed(
        30.0, 'The driver takes the nearest it has; 0 leaves it alone', '1/s', range=(0.0, 1000.0)
    )
    frame_timeout: float = _fixed(
        1.0,
        'Without a good frame for so long, a camera counts as frozen and is opened again',
        's',
        range=(0.05, 60.0),
    )
    usb_reset: bool = _fixed(
        False, 'Reset a camera on the USB bus when opening it again has not helped three times'
    )
    timestamp_offset: float = _option(
        0.0,
        "Added to every stamp; negative to go from the frame's arrival to its exposure",
        's',
        range=(-10.0, 10.0),
    )
    pair_tolerance: float = _option(
        0.0,
        'Largest difference between the stamps of a pair; 0 takes half a frame period',
        's',
        range=(0.0, 1.0),
    )
    lock_exposure: bool = _option(
        False, "Keep the right camera's exposure and gain equal to the left's"
    )

    def __post_init__(self) -> None:
        known_format(self.pixel_format)
        if self.side_by_side and self.width % 2:
            message = f'width {self.width}: a side-by-side image has an even width'
            raise CaptureError(message)
        if not self.side_by_side and self.left.device == self.right.device:
            message = (
                f'left.device and right.device are both {self.left.device!r}: name two cameras, '
                'or set side_by_side where one camera sends both views'
            )
            raise CaptureError(message)

    @property
    def wanted(self) -> Wanted:
        """How each camera is to be set up."""
        return Wanted(
            self.pixel_format,
            self.width,
            self.height,
            self.frame_rate,
            self.frame_timeout,
            self.usb_reset,
        )

    @property
    def view_size(self) -> tuple[int, int]:
        """Width and height (px) of one camera's view."""
        return (self.width // 2 if self.side_by_side else self.width), self.height

    def tolerance(self, frame_rate: float) -> float:
        """The largest difference (s) between the stamps of a pair at this frame rate (1/s)."""
        return self.pair_tolerance or 0.5 / (frame_rate or self.frame_rate or 30.0)
