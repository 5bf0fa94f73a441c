"""The kernel's monotonic stamps as ROS time, without drift and without jitter.

CLOCK_MONOTONIC and CLOCK_REALTIME tick together: time synchronisation slews both alike, and only
a step of the wall clock moves one against the other. Their offset is therefore a constant between
two steps. Each measurement brackets it: a wall-clock reading between two monotonic ones. The
brackets' intersection closes in on the constant; an empty intersection is a step.
"""

from __future__ import annotations

import time
from collections.abc import Callable

_BRACKETS = 5


class KernelToRos:
    """Turns stamps of CLOCK_MONOTONIC (ns) into ROS time (ns).

    :param ros_now_ns: the ROS clock, `lambda: node.get_clock().now().nanoseconds`.
    :ivar steps: how often the ROS clock was set while this one watched.
    """

    def __init__(
        self,
        ros_now_ns: Callable[[], int],
        monotonic_now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._ros_now_ns = ros_now_ns
        self._monotonic_now_ns = monotonic_now_ns
        self.steps = 0
        self._low, self._high = self._bracket()
        self._offset = (self._low + self._high) // 2
        self.measure()

    @property
    def offset_ns(self) -> int:
        """ROS time less monotonic time."""
        return self._offset

    @property
    def uncertainty_ns(self) -> int:
        """Half the width of what the offset has been narrowed down to."""
        return (self._high - self._low + 1) // 2

    def measure(self) -> None:
        """Look at both clocks again; to be called about once a second."""
        for _ in range(_BRACKETS):
            low, high = self._bracket()
            low, high = max(low, self._low), min(high, self._high)
            if low > high:
                self.steps += 1
                low, high = self._bracket()
            self._low, self._high = low, high
        # Kept where it is while it can be right: a stamp must not wander with each measurement.
        if not self._low <= self._offset <= self._high:
            self._offset = (self._low + self._high) // 2

    def stamp_ns(self, kernel_ns: int, timestamp_offset: float = 0.0) -> int:
        """The ROS time of a kernel stamp.

        :param timestamp_offset: seconds to add, negative where the kernel stamps the end of the
            transfer and the middle of the exposure is meant.
        """
        return kernel_ns + self._offset + round(timestamp_offset * 1e9)

    def _bracket(self) -> tuple[int, int]:
        before = self._monotonic_now_ns()
        ros = self._ros_now_ns()
        after = self._monotonic_now_ns()
        return ros - after, ros - before
