"""Positions that wait for the robot's pose at their stamp, which comes later than they do."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Generic, NamedTuple, TypeVar

from binopos_ros.platform.history import Missing
from binopos_ros.platform.rig_pose import RigPose
from binopos_ros.platform.stage import Platform

ItemT = TypeVar('ItemT')


class _Waiting(NamedTuple):
    stamp: int
    frame: str
    since: float


class WaitingRoom(Generic[ItemT]):
    """Hands on each position with the rig's pose, in the order in which positions came.

    Args:
        platform: knows the poses.
        patience: seconds for which a position waits.
    """

    def __init__(self, platform: Platform, patience: float) -> None:
        self._platform = platform
        self._patience = patience
        self._queue: deque[tuple[ItemT, _Waiting]] = deque()

    def add(self, item: ItemT, stamp: int, frame: str, now: float) -> None:
        """Take a position in: its stamp (ns), its frame, and the time (s) at which it came."""
        self._queue.append((item, _Waiting(stamp, frame, now)))

    def ready(self, now: float = float('inf')) -> Iterator[tuple[ItemT, RigPose | str]]:
        """Those that need not wait longer, each with the rig's pose or why there is none."""
        while self._queue:
            item, waiting = self._queue[0]
            found = self._platform.rig_pose(waiting.stamp, waiting.frame)
            if isinstance(found, Missing):
                if found.may_come and now - waiting.since < self._patience:
                    return
                self._queue.popleft()
                yield item, found.reason
            else:
                self._queue.popleft()
                yield item, found
