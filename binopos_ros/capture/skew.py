"""How far apart the frames of two cameras are taken."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from binopos_ros.pairing import Pair, PairMatcher, Unpaired
from binopos_ros.sides import SIDES

Floats = NDArray[np.float64]

_FEWEST_FOR_DRIFT = 10


@dataclass(frozen=True)
class Skew:
    """Right stamp less left stamp over the pairs in the window.

    :ivar median: s.
    :ivar percentile_99: of its magnitude, s.
    :ivar drift: of the right camera's clock against the left's, s/s; nan while too few pairs.
    :ivar pairs: how many are in the window.
    """

    median: float
    percentile_99: float
    drift: float
    pairs: int


class SkewMeter:
    """Pairs the kernel stamps of two cameras and measures their skew.

    :param tolerance: largest difference between the stamps of a pair, s.
    :param window: the number of pairs that the statistics are taken over.
    :ivar paired: pairs so far.
    :ivar unpaired: frames so far that found no partner, by side.
    """

    def __init__(self, tolerance: float, window: int = 900) -> None:
        self.paired = 0
        self.unpaired: Counter[str] = Counter({side: 0 for side in SIDES})
        self._matcher: PairMatcher[int] = PairMatcher(_nanoseconds(tolerance))
        self._pairs: deque[tuple[int, int]] = deque(maxlen=window)

    @property
    def tolerance(self) -> float:
        """Largest difference between the stamps of a pair, s."""
        return self._matcher.tolerance * 1e-9

    @tolerance.setter
    def tolerance(self, seconds: float) -> None:
        self._matcher.tolerance = _nanoseconds(seconds)

    def add(self, side: str, stamp_ns: int) -> None:
        """Take in the stamp of a frame; those of one side come in order."""
        self._count(self._matcher.add(side, stamp_ns, stamp_ns))

    def forget(self) -> None:
        """Start afresh, after a camera has been away; the counts go on."""
        self._count(self._matcher.flush())
        self._pairs.clear()

    def skew(self) -> Skew | None:
        """The statistics of the window; None while there is no pair."""
        if not self._pairs:
            return None
        stamps = np.array(self._pairs, dtype=np.int64)
        skews: Floats = np.multiply(stamps[:, 1] - stamps[:, 0], 1e-9, dtype=np.float64)
        return Skew(
            median=float(np.median(skews)),
            percentile_99=float(np.percentile(np.abs(skews), 99)),
            drift=_drift((stamps[:, 0] - stamps[0, 0]) * 1e-9, skews),
            pairs=len(skews),
        )

    def _count(self, events: Iterator[Pair[int] | Unpaired[int]]) -> None:
        for event in events:
            if isinstance(event, Pair):
                self._pairs.append((event.left, event.right))
                self.paired += 1
            else:
                self.unpaired[event.side] += 1


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


def _drift(seconds: Floats, skews: Floats) -> float:
    if len(skews) < _FEWEST_FOR_DRIFT:
        return float('nan')
    # Free-running cameras slide past each other: the skew jumps by a period when partners change.
    period = float(np.median(np.diff(seconds)))
    if period <= 0.0:
        return float('nan')
    return float(np.polyfit(seconds, np.unwrap(skews, period=period), 1)[0])
