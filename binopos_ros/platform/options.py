"""What the smoother may be told of the moving robot."""

from __future__ import annotations

from dataclasses import dataclass, field

from binopos_ros.parameters import check_options, option
from binopos_ros.platform.errors import PlatformError
from binopos_ros.platform.transforms import transform_of

SOURCES = ('none', 'tf', 'odometry')


@dataclass(frozen=True)
class PlatformOptions:
    """Where the rig's pose in the fixed frame comes from, and how well it is known."""

    source: str = option(
        'none',
        "where the robot's pose comes from: tf: /tf and /tf_static; odometry: platform/odometry "
        'and platform.mounting',
        choices=SOURCES,
        read_only=True,
    )
    mounting: tuple[float, ...] = option(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        "the left optical frame in the odometry's child frame: x, y, z in m, and the quaternion "
        'qx, qy, qz, qw',
        read_only=True,
    )
    timeout: float = option(
        0.2,
        "a position waits for so long for the robot's pose, and is dropped then",
        's',
        (0.0, 10.0),
        read_only=True,
    )
    max_gap: float = option(
        0.5,
        'nothing is interpolated between samples that lie further apart, nor beyond the newest',
        's',
        (0.001, 10.0),
        read_only=True,
    )
    max_speed: float = option(
        10.0,
        'between two samples the robot moves no faster; more is a jump',
        'm/s',
        (0.01, 1000.0),
        read_only=True,
    )
    max_turn_rate: float = option(
        10.0,
        'between two samples the robot turns no faster; more is a jump',
        'rad/s',
        (0.01, 1000.0),
        read_only=True,
    )
    position_std: float = option(
        0.0,
        "standard deviation of the robot's position from sample to sample, along each axis; 0: "
        "by the odometry's covariance, and where there is none, measured",
        'm',
        (0.0, 100.0),
        read_only=True,
    )
    rotation_std: float = option(
        0.0,
        'as platform.position_std, of its rotation about each axis',
        'rad',
        (0.0, 3.0),
        read_only=True,
    )
    stamp_std: float = option(
        0.0,
        'standard deviation of the time between the clocks of the robot and of the cameras: what '
        'moves fast is uncertain by as much as it moves in it',
        's',
        (0.0, 1.0),
        read_only=True,
    )

    def __post_init__(self) -> None:
        check_options(self, PlatformError)
        if len(self.mounting) != 7:
            msg = (
                f'platform.mounting has {len(self.mounting)} numbers: give seven, x, y, z, qx, '
                'qy, qz, qw'
            )
            raise PlatformError(msg)
        try:
            transform_of(self.mounting[:3], self.mounting[3:])
        except PlatformError as error:
            msg = f'platform.mounting has {error}'
            raise PlatformError(msg) from None


@dataclass(frozen=True)
class FixedFrameOptions:
    """Options of the smoother that let it work in a fixed frame."""

    fixed_frame: str = option(
        '',
        'frame of the poses, in which a target at rest stands still; empty: that of the rig. '
        'Needs platform.source',
        read_only=True,
    )
    platform: PlatformOptions = field(default_factory=PlatformOptions)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'fixed_frame', self.fixed_frame.lstrip('/'))
        if self.fixed_frame and self.platform.source == 'none':
            msg = (
                f"fixed_frame is '{self.fixed_frame}' and platform.source 'none': set "
                "platform.source to 'tf' or 'odometry'"
            )
            raise PlatformError(msg)
