"""The triangulation stage: centroids of two cameras in, positions with their covariance out.

It is the same object in the live node and in `binopos process`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.optics.camera_info import CameraInfo, stereo_from_camera_infos
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.pairing import SIDES, Pair, PairMatcher
from binopos_ros.triangulation.triangulate import triangulate

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
class Position:
    """A target position in the rig frame: (3,) m and its (3, 3) covariance m^2.

    `stamp` (nanoseconds) and `frame_id` are those of the left image; `index` is the refractive
    index of the target's medium that was used, `index_std` its standard deviation.
    """

    stamp: int
    frame_id: str
    point: NDArray[np.float64]
    covariance: NDArray[np.float64]
    index: float
    index_std: float
    index_observed: bool


@dataclass(frozen=True)
class Drop:
    """Something that gave no position, and why."""

    stamp: int
    reason: str


class Triangulator:
    """Pairs centroids and triangulates them, once both cameras' calibrations are known."""

    def __init__(self, options: TriangulatorOptions) -> None:
        self._infos: dict[str, CameraInfo] = {}
        self._rig: StereoRig | None = None
        self._early: deque[Pair[Centroid]] = deque()
        self._matcher = _matcher(options)
        self._options = options
        self._interfaces = options.interfaces()
        self.pairs = 0

    def configure(self, options: TriangulatorOptions) -> None:
        """Take new options; pairs that wait for a partner are kept unless the tolerance changes.

        Raises:
            TriangulationError, OpticsError: the options do not make a rig.
        """
        self._interfaces = options.interfaces()
        if options.pair_tolerance != self._options.pair_tolerance:
            self._matcher = _matcher(options)
        self._options = options
        self._build_rig()

    @property
    def rig(self) -> StereoRig | None:
        """The rig, or None while a calibration is missing."""
        return self._rig

    def set_camera(self, side: str, info: CameraInfo) -> None:
        """Take the calibration of one camera; the same one again costs nothing.

        Raises:
            OpticsError: the calibration cannot be used.
        """
        if self._infos.get(side) == info:
            return
        self._infos[side] = info
        self._build_rig()

    def add(self, side: str, centroid: Centroid) -> Iterator[Position | Drop]:
        """Take one centroid in; yield the positions, and the drops, that it decides."""
        for event in self._matcher.add(side, centroid.stamp, centroid):
            if isinstance(event, Pair):
                self.pairs += 1
                self._early.append(event)
            else:
                yield Drop(event.stamp, event.reason)
        if self._rig is not None:
            while self._early:
                yield self._triangulate(self._rig, self._early.popleft())
        while len(self._early) > EARLY_PAIRS:
            yield Drop(self._early.popleft().left.stamp, self._missing_calibration())

    def flush(self) -> Iterator[Drop]:
        """Give up on what waits for a partner or a calibration, at the end of a recording."""
        for event in self._matcher.flush():
            yield Drop(event.stamp, event.reason)
        while self._early:
            yield Drop(self._early.popleft().left.stamp, self._missing_calibration())

    def _build_rig(self) -> None:
        if len(self._infos) < 2:
            return
        interface, left_port, right_port = self._interfaces
        left, right, rotation, translation = stereo_from_camera_infos(
            self._infos['left'], self._infos['right']
        )
        self._rig = StereoRig(left, right, rotation, translation, interface, left_port, right_port)

    def _missing_calibration(self) -> str:
        missing = [side for side in SIDES if side not in self._infos]
        return f'no camera_info from {" and ".join(missing)}'

    def _triangulate(self, rig: StereoRig, pair: Pair[Centroid]) -> Position | Drop:
        left, right = pair.left, pair.right
        found = triangulate(
            rig,
            left.centre,
            right.centre,
            left.covariance,
            right.covariance,
            method=self._options.method,
        )
        reason = str(np.ravel(found.reasons)[0])
        if reason:
            return Drop(left.stamp, reason)
        miss = float(np.abs(found.residuals).max())
        if 0 < self._options.epipolar_gate < miss:
            return Drop(left.stamp, 'left and right do not see the same point')
        return Position(
            stamp=left.stamp,
            frame_id=left.frame_id,
            point=found.points.reshape(3),
            covariance=found.covariances.reshape(3, 3),
            index=_target_index(rig),
            index_std=0.0,
            index_observed=False,
        )


def _matcher(options: TriangulatorOptions) -> PairMatcher[Centroid]:
    tolerance = options.pair_tolerance
    return PairMatcher(None if tolerance is None else round(tolerance * 1e9))


def _target_index(rig: StereoRig) -> float:
    interface = rig.interface or rig.left_port
    return interface.target_index if interface is not None else 1.0
