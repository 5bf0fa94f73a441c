"""The cameras' options; the camera node declares its ROS parameters from them."""

from __future__ import annotations

from dataclasses import dataclass, field

from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.formats import known_format
from binopos_ros.parameters import option


@dataclass(frozen=True)
class Wanted:
    """How a camera is to be set up.

    :param frame_rate: 1/s; 0 takes what it is set to.
    :param frame_timeout: s without a good frame after which the camera counts as frozen.
    :param usb_reset: whether a camera that stays frozen may be reset, as the last resort.
    """

    pixel_format: str
    width: int
    height: int
    frame_rate: float = 0.0
    frame_timeout: float = 1.0
    usb_reset: bool = False


@dataclass(frozen=True)
class LeftOptions:
    """The left camera."""

    device: str = option(
        '/dev/video0',
        'Camera by its serial number, model (1209:0001), USB port (3-1.2), link below '
        '/dev/v4l/by-id or by-path, or node',
        read_only=True,
    )
    frame_id: str = option('left_camera_optical_frame', 'Frame of the images', read_only=True)
    camera_info_url: str = option('', 'Calibration: file://, package:// or a path', read_only=True)


@dataclass(frozen=True)
class RightOptions:
    """The right camera."""

    device: str = option('/dev/video2', 'As left.device', read_only=True)
    frame_id: str = option('right_camera_optical_frame', 'Frame of the images', read_only=True)
    camera_info_url: str = option('', 'Calibration: file://, package:// or a path', read_only=True)


@dataclass(frozen=True)
class CaptureOptions:
    """The cameras of the rig and how to set them up.

    :raises CaptureError: where a value is out of its range or does not fit the others.
    """

    left: LeftOptions = field(default_factory=LeftOptions)
    right: RightOptions = field(default_factory=RightOptions)
    side_by_side: bool = option(
        False,
        'left.device sends both views in one image, the left one on its left',
        read_only=True,
    )
    pixel_format: str = option(
        'MJPG', "Four letters as the driver's: MJPG is passed through", read_only=True
    )
    width: int = option(
        1280, 'Of the image as the camera sends it', 'px', limits=(1, 16384), read_only=True
    )
    height: int = option(
        720, 'Of the image as the camera sends it', 'px', limits=(1, 16384), read_only=True
    )
    frame_rate: float = option(
        30.0,
        'The driver takes the nearest it has; 0 leaves it alone',
        '1/s',
        limits=(0.0, 1000.0),
        read_only=True,
    )
    frame_timeout: float = option(
        1.0,
        'Without a good frame for so long, a camera counts as frozen and is opened again',
        's',
        limits=(0.05, 60.0),
        read_only=True,
    )
    usb_reset: bool = option(
        False,
        'Reset a camera on the USB bus when opening it again has not helped three times',
        read_only=True,
    )
    timestamp_offset: float = option(
        0.0,
        "Added to every stamp; negative to go from the frame's arrival to its exposure",
        's',
        limits=(-10.0, 10.0),
    )
    pair_tolerance: float = option(
        0.0,
        'Largest difference between the stamps of a pair; 0 takes half a frame period',
        's',
        limits=(0.0, 1.0),
    )
    lock_exposure: bool = option(
        False, "Keep the right camera's exposure and gain equal to the left's"
    )
    publish_tf: bool = option(
        False,
        "The right camera's frame under the left one's, by their calibration, on /tf_static",
        read_only=True,
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
