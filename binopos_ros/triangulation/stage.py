"""The triangulation stage: centroids of two cameras in, positions with their covariance out.

It is the same object in the live node and in `binopos process`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import StereoRig, stereo_contradictions, stereo_from_camera_infos
from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.covariance_file import read_covariance
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES
from binopos_ros.triangulation.locate import Locator, Place
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.skew import Movement, Sample, Track
from binopos_ros.triangulation.stated import stated_errors

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
class Position(Place):
    """A place in the rig frame; `stamp` (nanoseconds) and `frame_id` are the left image's."""

    stamp: int
    frame_id: str


@dataclass(frozen=True)
class Drop:
    """Something that gave no position, and why: a pair, or a centroid without a partner."""

    stamp: int
    reason: str
    is_pair: bool = True


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
        _locator_of(options, self._infos)

    @property
    def rig(self) -> StereoRig | None:
        """The rig, or None while a calibration is missing."""
        return None if self._locator is None else self._locator.rig

    @property
    def caution(self) -> str:
        """What makes positions worse than they look; '' for nothing."""
        told = []
        if len(self._infos) == len(SIDES):
            told += stereo_contradictions(*(self._infos[side] for side in SIDES))
        if self._defaults:
            told.append(
                f'the uncertainty of positions rests on the defaults of '
                f'{", ".join(self._defaults)}: calibrate with "binopos calibrate interface", or '
                'set them (0: exact)'
            )
        return '; '.join(told)

    @property
    def wave_level(self) -> float | None:
        """Deviation of the waves in the rays' miss, in pixel noise's; None where none can be."""
        return None if self._locator is None else self._locator.wave_level

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
                yield Drop(event.stamp, event.reason, is_pair=False)
        if self._locator is not None:
            while self._early:
                yield self._triangulate(self._locator, self._early.popleft())
        while len(self._early) > EARLY_PAIRS:
            early = self._early.popleft()
            yield Drop(early.left.centroid.stamp, self._missing_calibration())

    def flush(self) -> Iterator[Drop]:
        """Give up on what waits for a partner or a calibration, at the end of a recording."""
        for event in self._matcher.flush():
            yield Drop(event.stamp, event.reason, is_pair=False)
        while self._early:
            early = self._early.popleft()
            yield Drop(early.left.centroid.stamp, self._missing_calibration())

    def _build(self, options: TriangulatorOptions, infos: dict[str, CameraInfo]) -> None:
        """Take options and calibrations together, or, where they make no rig, neither."""
        self._locator, self._defaults = _locator_of(options, infos)
        self._refusal = next((one for info in infos.values() for one in info.outside()), '')
        self._infos, self._options = infos, options

    def _missing_calibration(self) -> str:
        missing = [side for side in SIDES if side not in self._infos]
        return f'no camera_info from {" and ".join(missing)}'

    def _triangulate(self, locator: Locator, pair: Pair[_Seen]) -> Position | Drop:
        left, right = pair.left.centroid, pair.right.centroid
        if self._refusal:
            return Drop(left.stamp, self._refusal)
        if self._options.triggered:
            right_centre, right_covariance = right.centre, right.covariance
        else:
            right_centre, right_covariance = pair.right.movement.at(left.stamp)
        views = (left.centre, right_centre, left.covariance, right_covariance)
        place = locator.locate(left.stamp * 1e-9, views, (left.diameter, right.diameter))
        if isinstance(place, str):
            return Drop(left.stamp, place)
        return Position(**vars(place), stamp=left.stamp, frame_id=left.frame_id)


def _locator_of(
    options: TriangulatorOptions, infos: dict[str, CameraInfo]
) -> tuple[Locator | None, tuple[str, ...]]:
    """What triangulates with these options, once both calibrations are here.

    Beside it the options whose defaults its covariance rests on.

    Raises:
        TriangulationError, OpticsError: options and calibrations do not fit together.
    """
    path = options.calibration_covariance
    calibration = read_covariance(Path(path)) if path else None
    if len(infos) < len(SIDES):
        shared, left, _ = options.interfaces()
        nearest = shared or left
        options.estimator(shared, nearest.target_index if nearest else None)
        return None, ()
    cameras = stereo_from_camera_infos(infos['left'], infos['right'])
    if not options.is_uncertain:
        return Locator(StereoRig(*cameras, *options.interfaces()), options), ()
    rig = UncertainRig(*cameras, *options.interfaces())
    stated = stated_errors(options, rig, calibration)
    return Locator(rig, options, stated.covariance), stated.defaults


def _matcher(options: TriangulatorOptions) -> PairMatcher[_Seen]:
    tolerance = options.pair_tolerance
    return PairMatcher(round(tolerance * 1e9) if tolerance > 0 else None)
