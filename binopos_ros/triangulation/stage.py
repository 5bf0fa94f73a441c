"""The triangulation stage: centroids of two cameras in, positions with their covariance out.

It is the same object in the live node and in `binopos process`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import OpticsError, StereoRig
from binopos_ros.optics.ball import ball_outline_offsets
from binopos_ros.optics.camera_info import CameraInfo, stereo_from_camera_infos
from binopos_ros.optics.covariance_file import read_covariance
from binopos_ros.optics.disc import to_disc_centres
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES
from binopos_ros.triangulation.index import DIFFERENT_POINTS, IndexEstimator
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.skew import Movement, Sample, Track
from binopos_ros.triangulation.triangulate import triangulate

#: Left and right centre, left and right covariance.
_Views = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

#: Pairs that wait for the first calibration: two seconds at 30 Hz.
EARLY_PAIRS = 60


@dataclass(frozen=True)
class Centroid:
    """The target's centre in one image: (2,) px, its (2, 2) covariance px^2, the diameter px."""

    stamp: int
    frame_id: str
    centre: NDArray[np.float64]
    covariance: NDArray[np.float64]
    diameter: float


@dataclass(frozen=True)
class Index:
    """The refractive index of the target's medium that a position rests on.

    `std` is 0 where the index is taken for exact; `observed` tells whether the rays determine it,
    or the prior alone; `frame` is what this pair alone gives (the paper's mean refractive index of
    the frame), nan where that is not determined.
    """

    mean: float
    std: float = 0.0
    observed: bool = False
    frame: float = math.nan


@dataclass(frozen=True)
class Position:
    """A target position in the rig frame: (3,) m and its (3, 3) covariance m^2.

    `stamp` (nanoseconds) and `frame_id` are those of the left image.
    """

    stamp: int
    frame_id: str
    point: NDArray[np.float64]
    covariance: NDArray[np.float64]
    index: Index


@dataclass(frozen=True)
class Drop:
    """Something that gave no position, and why."""

    stamp: int
    reason: str


class _Seen(NamedTuple):
    """A centroid, and how the target came there."""

    centroid: Centroid
    movement: Movement


class Triangulator:
    """Pairs centroids and triangulates them, once both cameras' calibrations are known."""

    def __init__(self, options: TriangulatorOptions) -> None:
        self._infos: dict[str, CameraInfo] = {}
        self._early: deque[Pair[_Seen]] = deque()
        self._matcher = _matcher(options)
        self._tracks = {side: Track() for side in SIDES}
        self.pairs = 0
        self._build(options, self._infos)

    def configure(self, options: TriangulatorOptions) -> None:
        """Take new options; pairs that wait for a partner are kept unless the tolerance changes.

        Raises:
            TriangulationError, OpticsError: the options do not make a rig.
        """
        before = self._options
        self._build(options, self._infos)
        if options.pair_tolerance != before.pair_tolerance:
            self._matcher = _matcher(options)

    def check(self, options: TriangulatorOptions) -> None:
        """See whether these options make a rig with the calibrations that are here.

        Raises:
            TriangulationError, OpticsError: they do not.
        """
        _rig_of(options, self._infos)

    @property
    def rig(self) -> StereoRig | None:
        """The rig, or None while a calibration is missing."""
        return self._rig

    def set_camera(self, side: str, info: CameraInfo) -> None:
        """Take the calibration of one camera; the same one again costs nothing.

        Raises:
            OpticsError: the calibration cannot be used; what was there before stays in use.
        """
        if self._infos.get(side) != info:
            # A fault of this side is told before the other side is there.
            info.camera()
            self._build(self._options, {**self._infos, side: info})

    def add(self, side: str, centroid: Centroid) -> Iterator[Position | Drop]:
        """Take one centroid in; yield the positions, and the drops, that it decides."""
        sample = Sample(centroid.stamp, centroid.centre, centroid.covariance)
        seen = _Seen(centroid, self._tracks[side].add(sample))
        for event in self._matcher.add(side, centroid.stamp, seen):
            if isinstance(event, Pair):
                self.pairs += 1
                self._early.append(event)
            else:
                yield Drop(event.stamp, event.reason)
        if self._rig is not None:
            while self._early:
                yield self._triangulate(self._rig, self._early.popleft())
        while len(self._early) > EARLY_PAIRS:
            early = self._early.popleft()
            yield Drop(early.left.centroid.stamp, self._missing_calibration())

    def flush(self) -> Iterator[Drop]:
        """Give up on what waits for a partner or a calibration, at the end of a recording."""
        for event in self._matcher.flush():
            yield Drop(event.stamp, event.reason)
        while self._early:
            early = self._early.popleft()
            yield Drop(early.left.centroid.stamp, self._missing_calibration())

    def _build(self, options: TriangulatorOptions, infos: dict[str, CameraInfo]) -> None:
        """Take options and calibrations together, or, where they make no rig, neither."""
        self._rig, self._covariance, self._estimator = _rig_of(options, infos)
        self._infos, self._options = infos, options

    def _missing_calibration(self) -> str:
        missing = [side for side in SIDES if side not in self._infos]
        return f'no camera_info from {" and ".join(missing)}'

    def _triangulate(self, rig: StereoRig, pair: Pair[_Seen]) -> Position | Drop:
        left, right = pair.left.centroid, pair.right.centroid
        if self._options.triggered:
            right_centre, right_covariance = right.centre, right.covariance
        else:
            right_centre, right_covariance = pair.right.movement.at(left.stamp)
        views: _Views = (left.centre, right_centre, left.covariance, right_covariance)
        if self._options.target.diameter > 0:
            try:
                views = self._centred(rig, views)
            except OpticsError as error:
                return Drop(left.stamp, str(error))
        if self._estimator is not None:
            state = self._estimator.update(rig, *views, stamp=left.stamp * 1e-9)
            if not np.isfinite(state.point).all():
                return Drop(left.stamp, state.reason)
            index = Index(state.mean, state.std, state.observed, state.frame_index)
            point, covariance, residuals = state.point, state.covariance, state.residuals
        else:
            found = triangulate(
                rig,
                *views,
                method=self._options.method,
                parameter_covariance=self._covariance,
            )
            if found.reasons:
                return Drop(left.stamp, str(found.reasons))
            point, covariance, residuals = found.points, found.covariances, found.residuals
            index = Index(rig.target_index or 1.0)
        if 0 < self._options.epipolar_gate < np.abs(residuals).max():
            return Drop(left.stamp, DIFFERENT_POINTS)
        return Position(left.stamp, left.frame_id, point, covariance, index)

    def _centred(self, rig: StereoRig, views: _Views) -> _Views:
        """The images of the target's centre instead of the outlines' centres."""
        found = triangulate(rig, *views)
        if found.reasons:
            # It will be told where the pair itself is triangulated.
            return views
        target = self._options.target
        if target.shape == 'ball':
            offsets = ball_outline_offsets(rig.project, found.points, target.diameter)
            return views[0] - offsets[0], views[1] - offsets[1], views[2], views[3]
        nearest = rig.interface or rig.left_port
        flat = nearest.normal if nearest is not None else np.array([0.0, 0.0, 1.0])
        normal = np.array(target.normal) if target.normal else flat
        left, right = to_disc_centres(
            rig.project, views[:2], found.points, normal, target.diameter
        )
        return left, right, views[2], views[3]


def _rig_of(
    options: TriangulatorOptions, infos: dict[str, CameraInfo]
) -> tuple[StereoRig | None, NDArray[np.float64] | None, IndexEstimator | None]:
    """The rig, its parameters' covariance and the estimate of the index, as far as they are."""
    path = options.calibration_covariance
    calibration = read_covariance(Path(path)) if path else None
    rig, covariance = None, None
    if len(infos) == len(SIDES):
        cameras = stereo_from_camera_infos(infos['left'], infos['right'])
        kind = StereoRig if calibration is None else UncertainRig
        rig = kind(*cameras, *options.interfaces())
        if calibration is not None:
            covariance = calibration.ordered(rig.parameter_names)
    return rig, covariance, options.estimator(covariance)


def _matcher(options: TriangulatorOptions) -> PairMatcher[_Seen]:
    tolerance = options.pair_tolerance
    return PairMatcher(round(tolerance * 1e9) if tolerance > 0 else None)
