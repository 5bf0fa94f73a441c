"""The stages of the live nodes one after another, without transport: for bags and experiments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from binopos_ros.detection import DetectionError, DetectorOptions, Frame
from binopos_ros.detection.stage import CameraStage
from binopos_ros.optics import CameraInfo
from binopos_ros.parameters import build
from binopos_ros.sides import SIDES
from binopos_ros.smoothing.stage import Pose, make_smoother
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Drop, Position, Triangulator


@dataclass(frozen=True)
class Seen:
    """The target in one image."""

    side: str
    centroid: Centroid


@dataclass(frozen=True)
class Located:
    """The target's position from one pair, and the filtered pose at its stamp, if there is one."""

    position: Position
    pose: Pose | None


@dataclass(frozen=True)
class Dropped:
    """Something that a stage could not use."""

    stamp: int
    reason: str


Event = Seen | Located | Dropped


class Pipeline:
    """Detection in both cameras, triangulation and smoothing.

    Args:
        parameters: values by node ('detector', 'triangulator', 'smoother') and parameter name, as
            the nodes would get them.

    Raises:
        ParameterError, or the error of a room: the parameters cannot be used.
    """

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]]) -> None:
        detection = build(DetectorOptions, parameters['detector'])
        self._cameras = {side: CameraStage(detection) for side in SIDES}
        self._triangulator = Triangulator(build(TriangulatorOptions, parameters['triangulator']))
        self._smoother = make_smoother(parameters['smoother'])

    def set_camera(self, side: str, info: CameraInfo) -> None:
        """Take a camera's calibration.

        Raises:
            OpticsError: it cannot be used.
        """
        self._cameras[side].set_camera(info)
        self._triangulator.set_camera(side, info)

    def add(
        self, side: str, stamp: int, frame_id: str, decoded: Frame | DetectionError
    ) -> Iterator[Event]:
        """Take one decoded image in; yield what it leads to.

        Args:
            side: 'left' or 'right'.
            stamp: nanoseconds.
            frame_id: of the image.
            decoded: the result of `detection.stage.try_decode`.
        """
        detection = self._cameras[side].detect(stamp, decoded)
        if detection.target is None:
            yield Dropped(stamp, f'{side}: {detection.reason}')
            return
        target = detection.target
        centroid = Centroid(stamp, frame_id, target.centre, target.covariance, target.diameter)
        yield Seen(side, centroid)
        yield from self._smooth(self._triangulator.add(side, centroid))

    def flush(self) -> Iterator[Event]:
        """Give up on what still waits, at the end of a recording."""
        yield from self._smooth(self._triangulator.flush())

    def _smooth(self, results: Iterable[Position | Drop]) -> Iterator[Event]:
        for result in results:
            if isinstance(result, Drop):
                yield Dropped(result.stamp, result.reason)
                continue
            pose, reason = self._smoother.add(
                result.stamp, result.point, result.covariance, result.systematic, result.medium
            )
            yield Located(result, pose)
            if reason:
                yield Dropped(result.stamp, f'smoother: {reason}')
