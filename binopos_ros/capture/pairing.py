"""Two cameras as one: how far apart their frames are taken, and one picture that holds both."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from binopos_ros.capture.errors import CaptureError

Floats = NDArray[np.float64]

LEFT, RIGHT = SIDES = ('left', 'right')
_WAITING = 64
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
        self.tolerance = tolerance
        self.paired = 0
        self.unpaired: Counter[str] = Counter({side: 0 for side in SIDES})
        self._waiting: dict[str, list[int]] = {side: [] for side in SIDES}
        self._pairs: deque[tuple[int, int]] = deque(maxlen=window)

    def add(self, side: str, stamp_ns: int) -> None:
        """Take in the stamp of a frame; those of one side come in order."""
        other = RIGHT if side == LEFT else LEFT
        partners = self._waiting[other]
        tolerance_ns = round(self.tolerance * 1e9)
        # Stamps come in order, so what lies too far back can meet nothing that is yet to come.
        self._give_up(other, bisect_left(partners, stamp_ns - tolerance_ns))
        nearest = min(partners, key=lambda stamp: abs(stamp - stamp_ns), default=None)
        if nearest is None or abs(nearest - stamp_ns) > tolerance_ns:
            self._waiting[side].append(stamp_ns)
            self._give_up(side, max(0, len(self._waiting[side]) - _WAITING))
            return
        self._give_up(other, partners.index(nearest))
        partners.pop(0)
        self._give_up(side, len(self._waiting[side]))
        left, right = (stamp_ns, nearest) if side == LEFT else (nearest, stamp_ns)
        self._pairs.append((left, right))
        self.paired += 1

    def forget(self) -> None:
        """Start afresh, after a camera has been away; the counts go on."""
        for side in SIDES:
            self._give_up(side, len(self._waiting[side]))
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

    def _give_up(self, side: str, count: int) -> None:
        del self._waiting[side][:count]
        self.unpaired[side] += count


def split_side_by_side(picture: NDArray[np.uint8]) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Split a picture that holds the left view beside the right one.

    :param picture: (height, 2 width, ...).
    :returns: the two halves, (height, width, ...), as views.
    :raises CaptureError: where the width is odd.
    """
    width = picture.shape[1]
    if width % 2:
        message = (
            f'a side-by-side image of odd width {width} px cannot be split; choose another size'
        )
        raise CaptureError(message)
    return picture[:, : width // 2], picture[:, width // 2 :]


def _drift(seconds: Floats, skews: Floats) -> float:
    if len(skews) < _FEWEST_FOR_DRIFT:
        return float('nan')
    # Free-running cameras slide past each other: the skew jumps by a period when partners change.
    period = float(np.median(np.diff(seconds)))
    if period <= 0.0:
        return float('nan')
    return float(np.polyfit(seconds, np.unwrap(skews, period=period), 1)[0])
