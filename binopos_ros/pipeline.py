"""The stages of the live nodes one after another, without transport: for bags and experiments."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from binopos_ros.arrivals import ArrivalOptions
from binopos_ros.detection import (
    DetectionError,
    DetectorOptions,
    Frame,
    JpegImage,
    RawImage,
)
from binopos_ros.detection.stage import stages_of_pair
from binopos_ros.optics import CameraInfo
from binopos_ros.parameters import build, specs_of
from binopos_ros.platform import FixedFrameOptions, Platform, WaitingRoom
from binopos_ros.smoothing.health import Health, HealthMonitor
from binopos_ros.smoothing.stage import Pose, make_smoother
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Drop, Position, Triangulator

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seen:
    """The target in one image."""

    side: str
    centroid: Centroid


@dataclass(frozen=True)
class Located:
    """The target's position from one pair, and the filtered pose at its stamp, if there is one.

    `frame_id` is the pose's frame: that of the position, or the fixed one.
    """

    position: Position
    pose: Pose | None
    frame_id: str


@dataclass(frozen=True)
class Dropped:
    """Something that a stage could not use: of a pair of pictures, or of the robot's motion."""

    stamp: int
    reason: str
    of_pair: bool = True


@dataclass(frozen=True)
class Judged:
    """What is to be thought of the target at a stamp (ns); `frame_id` is the pose's frame."""

    stamp: int
    health: Health
    frame_id: str


Event = Seen | Located | Dropped | Judged


class Pipeline:
    """Detection in both cameras, triangulation and smoothing.

    Args:
        parameters: values by node ('detector', 'triangulator', 'smoother') and parameter name, as
            the nodes would get them.

    Raises:
        ParameterError, or the error of a room: the parameters cannot be used.
    """

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]]) -> None:
        self._cameras = stages_of_pair(detector_options(parameters['detector']))
        self._triangulator = Triangulator(build(TriangulatorOptions, parameters['triangulator']))
        smoothing = parameters['smoother']
        self._platform = make_platform(smoothing)
        fixed = specs_of(FixedFrameOptions)
        self._smoother = make_smoother({k: v for k, v in smoothing.items() if k not in fixed})
        self._health = HealthMonitor()
        self._now = 0
        self._frame_id = self._platform.options.fixed_frame
        own = self._platform.options.platform
        # Nobody waits here: what comes after a gap is of no use.
        self._waiting: WaitingRoom[Position] = WaitingRoom(
            self._platform, max(own.timeout, own.max_gap)
        )

    @property
    def platform(self) -> Platform:
        """Where the rig is in the fixed frame."""
        return self._platform

    @property
    def child_frame(self) -> str:
        """The target's own frame."""
        return self._smoother.options.child_frame

    @property
    def caution(self) -> str:
        """What makes positions worse than they look; '' for nothing."""
        return self._triangulator.caution

    def set_camera(self, side: str, info: CameraInfo) -> None:
        """Take a camera's calibration.

        Raises:
            OpticsError: it cannot be used.
        """
        self._cameras[side].set_camera(info)
        self._triangulator.set_camera(side, info)

    def prepare(
        self, side: str, image: JpegImage | RawImage, ahead: int
    ) -> Frame | DetectionError:
        """What `add` takes in of an image; see `CameraStage.prepare`."""
        return self._cameras[side].prepare(image, ahead)

    def add(
        self, side: str, stamp: int, frame_id: str, decoded: Frame | DetectionError
    ) -> Iterator[Event]:
        """Take one decoded image in; yield what it leads to.

        Args:
            side: 'left' or 'right'.
            stamp: nanoseconds.
            frame_id: of the image.
            decoded: the result of `prepare`.
        """
        yield from self._reach(stamp)
        yield from self._look(side, stamp, frame_id, decoded)
        yield from self._judge()

    def _look(
        self, side: str, stamp: int, frame_id: str, decoded: Frame | DetectionError
    ) -> Iterator[Event]:
        detection = self._cameras[side].detect(stamp, decoded)
        if detection.target is None:
            yield Dropped(stamp, f'{side}: {detection.reason}')
            return
        target = detection.target
        centroid = Centroid(stamp, frame_id, target.centre, target.covariance, target.diameter)
        yield Seen(side, centroid)
        yield from self._smooth(self._triangulator.add(side, centroid))

    def add_transform(
        self, transform: tuple[int, str, str, Any, Any], static: bool
    ) -> Iterator[Event]:
        """Take a transform in: stamp (ns), parent, child, translation (m), quaternion."""
        reason = self._platform.tree.add(*transform, static=static)
        if reason:
            yield Dropped(transform[0], f'platform: {reason}', of_pair=False)
        elif not static:
            yield from self._reach(transform[0])

    def add_odometry(self, sample: tuple[int, str, str, Any, Any, Any]) -> Iterator[Event]:
        """Take the robot's pose in: stamp (ns), frame, child, position (m), quaternion, (6, 6)."""
        stamp = sample[0]
        reason = self._platform.odometry.add(*sample)
        if reason:
            yield Dropped(stamp, f'platform: {reason}', of_pair=False)
        yield from self._reach(stamp)

    def flush(self) -> Iterator[Event]:
        """Give up on what still waits, at the end of a recording."""
        yield from self._smooth(self._triangulator.flush())
        yield from self._smooth_placed(math.inf)
        yield from self._judge()

    def _smooth(self, results: Iterable[Position | Drop]) -> Iterator[Event]:
        for result in results:
            if isinstance(result, Drop):
                yield Dropped(result.stamp, result.reason)
                continue
            if self._platform.active:
                self._waiting.add(result, result.stamp, result.frame_id, result.stamp * 1e-9)
                yield from self._smooth_placed(self._now * 1e-9)
                continue
            self._frame_id = result.frame_id
            measured = (result.point, result.covariance, result.systematic, result.medium)
            yield from self._filtered(result, *measured)

    def _reach(self, stamp: int) -> Iterator[Event]:
        """Let time pass until this stamp (ns): smooth what has waited for the robot's pose."""
        self._now = stamp
        if self._platform.active:
            yield from self._smooth_placed(stamp * 1e-9)
        yield from self._judge()

    def _judge(self) -> Iterator[Event]:
        """Say what is to be thought of the target, where that is news."""
        options = self._smoother.options
        health = self._health.news(self._now * 1e-9, options.health, options.sensor_timeout)
        if health is not None:
            yield Judged(self._now, health, self._frame_id)

    def _smooth_placed(self, now: float) -> Iterator[Event]:
        for position, rig in self._waiting.ready(now):
            if isinstance(rig, str):
                self._health.refuse(rig)
                yield Located(position, None, self._frame_id)
                yield Dropped(position.stamp, f'smoother: {rig}')
                continue
            placed = rig.carry(
                position.point, position.covariance, position.systematic, position.medium
            )
            yield from self._filtered(position, *placed)

    def _filtered(
        self,
        position: Position,
        point: Array,
        covariance: Array,
        systematic: Array | None,
        medium: Array | None,
    ) -> Iterator[Event]:
        """Filter a position that lies in the pose's frame: its point, covariance and parts."""
        pose, reason = self._smoother.add(position.stamp, point, covariance, systematic, medium)
        if pose is not None:
            self._health.pose(pose.state.covariance[:3, :3])
        yield Located(position, pose, self._frame_id)
        if not reason:
            self._health.use(self._now * 1e-9)
        else:
            self._health.refuse(reason)
            yield Dropped(position.stamp, f'smoother: {reason}')


def make_platform(values: Mapping[str, Any]) -> Platform:
    """The platform from the flat parameter values of the smoother, among which are its own.

    Raises:
        ParameterError, PlatformError: the values cannot be used.
    """
    own = specs_of(FixedFrameOptions)
    return Platform(build(FixedFrameOptions, {k: v for k, v in values.items() if k in own}))


def detector_options(values: Mapping[str, Any]) -> DetectorOptions:
    """The detector's options; how a live node takes its pictures in is not among them.

    Raises:
        ParameterError, DetectionError: the values cannot be used.
    """
    of_node = specs_of(ArrivalOptions)
    own = {name: value for name, value in values.items() if name not in of_node}
    options: DetectorOptions = build(DetectorOptions, own)
    return options
