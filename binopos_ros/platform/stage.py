"""The platform's stage: the robot's motion in, the rig's pose in the fixed frame out.

It is the same object in the live node and in `binopos process`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.platform.history import Limits, Missing
from binopos_ros.platform.odometry import Odometry
from binopos_ros.platform.options import FixedFrameOptions
from binopos_ros.platform.rig_pose import PlacedRig, RigPose
from binopos_ros.platform.transforms import transform_of
from binopos_ros.platform.tree import TransformTree

Array = NDArray[np.float64]


class Platform:
    """Where the rig is in the fixed frame.

    Attributes:
        options: as they were given.
        tree: of transforms; fed where `platform.source` is `tf`.
        odometry: of the robot; fed where it is `odometry`.
    """

    def __init__(self, options: FixedFrameOptions) -> None:
        self.options = options
        own = options.platform
        limits = Limits(own.max_gap, own.max_speed, own.max_turn_rate)
        mounting = transform_of(own.mounting[:3], own.mounting[3:])
        self.tree = TransformTree(limits)
        self.odometry = Odometry(options.fixed_frame, mounting, limits)
        self._given: Array | None = None
        if own.position_std or own.rotation_std:
            self._given = np.diag([own.position_std**2] * 3 + [own.rotation_std**2] * 3)
        self._last: int | None = None

    @property
    def active(self) -> bool:
        """Whether there is a fixed frame at all."""
        return bool(self.options.fixed_frame)

    @property
    def source(self) -> str:
        """Where the robot's pose has to come from: 'none', 'tf' or 'odometry'."""
        return self.options.platform.source if self.active else 'none'

    def rig_pose(self, stamp: int, rig_frame: str) -> RigPose | Missing:
        """The rig's pose for a position, or why there is none; call it once for each position.

        Args:
            stamp: of the position, ns.
            rig_frame: that the position is in.
        """
        own = self.options.platform
        sample, drift = self._given, None
        if own.source == 'odometry':
            placed = self.odometry.rig_at(stamp, moving=own.stamp_std > 0)
            if isinstance(placed, Missing):
                return placed
            if sample is None:
                sample, drift = self.odometry.covariance_at(stamp)
        else:
            frames = self.options.fixed_frame, rig_frame.lstrip('/')
            found = self.tree.rig_in(*frames, stamp, moving=own.stamp_std > 0)
            if isinstance(found, Missing):
                return found
            placed = found
            if sample is None and placed.span:
                sample = self.tree.covariance_of(*frames, stamp, placed.pivot)
        if sample is not None:
            sample = sample * self._factor(placed, stamp)
        self._last = stamp
        return RigPose(placed, sample, drift, own.stamp_std)

    def _factor(self, placed: PlacedRig, stamp: int) -> float:
        """What is left of the samples' noise in a position.

        Interpolation averages it. Positions that come faster than samples share them: so that
        many of them together are no better than the samples that they rest on, each is taken for
        as much worse. Of those that come up to twice as slowly some share a sample with their
        neighbours: of positions `apart` samples from each other, a share 2 - apart, by the
        integral of u (2 - apart - u) over u from 0 to that; so much of the variance is common to
        each and both its neighbours, in the mean.
        """
        interval = 0.0 if self._last is None else (stamp - self._last) * 1e-9
        if interval <= 0.0 or placed.span == 0.0:
            return placed.white
        apart = interval / placed.span
        if apart < 1.0:
            return max(placed.white, 1.0 / apart)
        return placed.white + max(2.0 - apart, 0.0) ** 3 / 3.0
