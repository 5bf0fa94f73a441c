"""A right image that was taken at another instant than the left one: where the target was then.

Free-running cameras take the two images of a pair up to half a frame period apart. A target that
moves is then seen at two places, and a shift along the baseline is a disparity: the position errs
by many times the way gone. But the right camera's own centroids tell how the target moves in its
image. With c_k and c_m a centroid and an earlier one, T = t_k - t_m, and s = t_k - t the skew,

    c(t) = (1 - w) c_k + w c_m,    w = s / T,

interpolated where the right image is the later one and extrapolated where it is the earlier. Both
centroids' noise goes in with its weight. What is left is the acceleration a, (a / 2) s (T - s) of
it, with a from the second differences of the last centroids, less what their noise explains. Of
the last centroids that one serves as c_m which leaves the smallest variance: the last where the
target swerves, an earlier one where it keeps its way, since that one adds less noise.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Earlier centroids that may serve, and second differences that tell the acceleration.
EARLIER, SWERVES = 4, 9
#: Centroids farther apart than this, ns, do not belong to one movement.
LONGEST_GAP = 2_000_000_000
#: Standard deviation of the velocity of a target that has not been followed yet, px/s.
UNKNOWN_SPEED = 300.0
#: Median of the mean of two standard normals' squares.
MEDIAN_SQUARE = math.log(2.0)


class Sample(NamedTuple):
    """A centroid of one camera: stamp ns, (2,) px, (2, 2) px^2."""

    stamp: int
    centre: Floats
    covariance: Floats


@dataclass(frozen=True)
class Movement:
    """How a target has come to where one camera sees it.

    Attributes:
        now: the centroid.
        earlier: the ones before it, newest first.
        acceleration: mean square of its components, px^2/s^4.
    """

    now: Sample
    earlier: tuple[Sample, ...]
    acceleration: float

    def at(self, stamp: int) -> tuple[Floats, Floats]:
        """Return where the target was, (2,) px, and the covariance of that, (2, 2) px^2.

        Args:
            stamp: ns, less than half a frame period away.
        """
        now = self.now
        skew = _seconds(now.stamp - stamp)
        if skew == 0.0:
            return now.centre, now.covariance
        if not self.earlier:
            return now.centre, now.covariance + (UNKNOWN_SPEED * skew) ** 2 * np.eye(2)
        found = [self._between(sample, skew) for sample in self.earlier]
        return min(found, key=lambda place: float(place[1].trace()))

    def _between(self, sample: Sample, skew: float) -> tuple[Floats, Floats]:
        """The place and its covariance by this earlier centroid."""
        span = _seconds(self.now.stamp - sample.stamp)
        weight = skew / span
        left_out = 0.25 * self.acceleration * (skew * (span - skew)) ** 2
        covariance = (
            (1.0 - weight) ** 2 * self.now.covariance
            + weight**2 * sample.covariance
            + left_out * np.eye(2)
        )
        return (1.0 - weight) * self.now.centre + weight * sample.centre, covariance


class Track:
    """The last centroids of one camera."""

    def __init__(self) -> None:
        self._samples: deque[Sample] = deque(maxlen=EARLIER + 1)
        self._swerves: deque[float] = deque(maxlen=SWERVES)

    def add(self, sample: Sample) -> Movement:
        """Take the next centroid in; one that is not finite tells of no movement."""
        if not (np.isfinite(sample.centre).all() and np.isfinite(sample.covariance).all()):
            return Movement(sample, (), 0.0)
        if self._samples and not 0 < sample.stamp - self._samples[-1].stamp < LONGEST_GAP:
            self._samples.clear()
            self._swerves.clear()
        self._samples.append(sample)
        newest = list(self._samples)[::-1]
        if len(newest) < 2:
            return Movement(sample, (), 0.0)
        if len(newest) < 3:
            # It may have started between the two: its whole velocity within one period.
            span = _seconds(sample.stamp - newest[1].stamp)
            start = float(np.sum(((sample.centre - newest[1].centre) / span**2) ** 2))
            return Movement(sample, tuple(newest[1:]), start)
        swerve, noise = _swerve(*newest[:3])
        self._swerves.append(swerve)
        usual = _median(self._swerves) / MEDIAN_SQUARE
        acceleration = max(usual, swerve) - noise
        return Movement(sample, tuple(newest[1:]), max(acceleration, 0.0))


def _median(values: Collection[float]) -> float:
    """The middle one, or the mean of the two there; `statistics` takes a hundredth of a start."""
    ordered, count = sorted(values), len(values)
    return (ordered[(count - 1) // 2] + ordered[count // 2]) / 2


def _swerve(now: Sample, before: Sample, first: Sample) -> tuple[float, float]:
    """Mean square of the acceleration's two components from three centroids, and of its noise."""
    late, early = _seconds(now.stamp - before.stamp), _seconds(before.stamp - first.stamp)
    mean = 0.5 * (late + early)
    change = (now.centre - before.centre) / late - (before.centre - first.centre) / early
    noise = (
        np.trace(now.covariance) / late**2
        + np.trace(before.covariance) * (1.0 / late + 1.0 / early) ** 2
        + np.trace(first.covariance) / early**2
    )
    return float(np.sum((change / mean) ** 2)) / 2.0, float(noise) / (2.0 * mean**2)


def _seconds(nanoseconds: int) -> float:
    return nanoseconds * 1e-9
