"""The rig's place from an odometry of the robot, and how the rig is mounted on it."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from binopos_ros.platform.errors import PlatformError
from binopos_ros.platform.history import History, Limits, Missing
from binopos_ros.platform.noise import parted
from binopos_ros.platform.rig_pose import AT_REST, PlacedRig, rates
from binopos_ros.platform.transforms import Transform, joined, transform_of

Array = NDArray[np.float64]


class Odometry:
    """Poses of the robot with their covariances, as nav_msgs/Odometry has them.

    Args:
        fixed_frame: the frame that the odometry must be in.
        mounting: the rig in the odometry's child frame.
        limits: between which samples nothing is interpolated.
    """

    def __init__(self, fixed_frame: str, mounting: Transform, limits: Limits) -> None:
        self._fixed_frame = fixed_frame
        self._mounting = mounting
        self._child = ''
        self._history = History('the odometry', limits)
        self._covariances: list[Array | None] = []

    def add(
        self,
        stamp: int,
        frame: str,
        child: str,
        position: Sequence[float],
        rotation: Sequence[float],
        covariance: Array,
    ) -> str:
        """Take a sample in; '' or why it cannot be used.

        Args:
            stamp: ns.
            frame, child: the frames.
            position: m.
            rotation: x, y, z, w.
            covariance: (6, 6) of position and rotation; one whose diagonal is not positive is
                none.
        """
        frame, child = frame.lstrip('/'), child.lstrip('/')
        if frame != self._fixed_frame:
            return f"the odometry is in the frame '{frame}', not in '{self._fixed_frame}'"
        if child != self._child and self._child:
            return f"the odometry is of '{child}' beside one of '{self._child}'"
        try:
            transform = transform_of(position, rotation)
        except PlatformError as error:
            return f'the odometry has {error}'
        self._child = child
        history = self._history
        count = len(history.stamps)
        at, problem = history.add(stamp, transform)
        if at < 0:
            return problem
        if len(history.stamps) <= count:
            self._covariances.clear()
        known = math.isfinite(covariance.sum()) and min(covariance.diagonal().tolist()) > 0
        self._covariances.insert(at, covariance if known else None)
        old = history.too_old()
        history.drop_oldest(old)
        del self._covariances[:old]
        return ''

    def rig_at(self, stamp: int, moving: bool) -> PlacedRig | Missing:
        """Where the rig is at a stamp (ns), or why that is unknown.

        `moving`: how fast it moves and turns is wanted too.
        """
        history = self._history
        bracket = history.bracket(stamp)
        if isinstance(bracket, Missing):
            return bracket
        robot = history.at(bracket)
        pose = joined(robot, self._mounting)
        weight, span = bracket.weight, history.span(bracket)
        velocity = turn = AT_REST
        if span and moving:
            second = min(bracket.first + 1, len(history.stamps) - 1)
            ends = (history.transforms[second - 1], history.transforms[second])
            before, after = (joined(end, self._mounting) for end in ends)
            velocity, turn = rates(before, after, span)
        white = (1 - weight) ** 2 + weight**2
        return PlacedRig(pose, robot.translation, white, span, velocity, turn)

    def covariance_at(self, stamp: int) -> tuple[Array | None, Array | None]:
        """(6, 6) of what differs from sample to sample, and of what drifts; None: none is known.

        Where none is stated, it is what the samples themselves show.

        Args:
            stamp: ns, one that `rig_at` knows.
        """
        at = bisect_right(self._history.stamps, stamp) - 1
        covariance = self._covariances[at]
        if covariance is None:
            measure = self._history.measures[at]
            return None if measure is None else np.diag(measure.variances), None
        return parted(covariance, self._history.measures[at])
