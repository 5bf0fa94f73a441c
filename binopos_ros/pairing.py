"""Left and right, brought together by their stamps.

A left and a right item make a pair when their stamps differ by at most the tolerance. Where no
tolerance is given it is half of the frame period. That is measured from the intervals between
stamps of one side: frames that were lost make them multiples of the period, so it is the median of
those that are single. A median of all would be twice the period where every other frame is lost,
and pair each left image with the right one before it.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from binopos_ros.sides import SIDES

Item = TypeVar('Item')

#: Tolerance in nanoseconds until two stamps of one side are known.
FIRST_TOLERANCE = 5_000_000
#: A stamp that lies this many nanoseconds before its predecessor starts a new recording.
RESTART = 1_000_000_000
#: Items of one side that wait for a partner, and intervals that the period is taken from.
WAITING = 64
INTERVALS = 240
#: Of those sorted, the share at which a single period is looked for, and the largest multiple of
#: what is found there that is one too.
SINGLE, LONGEST_SINGLE = 0.1, 1.5


@dataclass(frozen=True)
class Pair(Generic[Item]):
    """A left and a right item of one instant."""

    left: Item
    right: Item


@dataclass(frozen=True)
class Unpaired(Generic[Item]):
    """An item that found no partner, and why; `repeated` where its stamp had come before."""

    side: str
    stamp: int
    item: Item
    reason: str
    repeated: bool = False


class Intervals:
    """The newest intervals between frames, and the frame period that they tell."""

    def __init__(self) -> None:
        self._newest: deque[int] = deque()
        self._sorted: list[int] = []

    def add(self, interval: int) -> None:
        """Take an interval in, nanoseconds."""
        if len(self._newest) == INTERVALS:
            self._sorted.pop(bisect.bisect_left(self._sorted, self._newest.popleft()))
        self._newest.append(interval)
        bisect.insort(self._sorted, interval)

    def period(self) -> int | None:
        """The median of the intervals that are a single period; None where there is none yet."""
        if not self._sorted:
            return None
        first = int(SINGLE * len(self._sorted))
        last = bisect.bisect_right(self._sorted, LONGEST_SINGLE * self._sorted[first])
        return self._sorted[(first + last) // 2]


class PairMatcher(Generic[Item]):
    """Matches two streams of stamped items, each of which may come late or not at all.

    Args:
        tolerance: largest difference between the stamps of a pair, in nanoseconds; None takes half
            of the measured frame period.
    """

    def __init__(self, tolerance: int | None = None) -> None:
        self._given_tolerance = tolerance
        self.reset()

    def reset(self) -> None:
        """Forget all that waits."""
        self._waiting: dict[str, list[tuple[int, Item]]] = {side: [] for side in SIDES}
        self._newest: dict[str, int | None] = dict.fromkeys(SIDES)
        self._intervals = Intervals()

    @property
    def period(self) -> int | None:
        """The frame period, nanoseconds; None before two stamps of one side are known."""
        return self._intervals.period()

    @property
    def tolerance(self) -> int:
        """Largest difference between the stamps of a pair now, in nanoseconds."""
        if self._given_tolerance is not None:
            return self._given_tolerance
        return FIRST_TOLERANCE if self.period is None else self.period // 2

    @tolerance.setter
    def tolerance(self, nanoseconds: int) -> None:
        self._given_tolerance = nanoseconds

    def add(self, side: str, stamp: int, item: Item) -> Iterator[Pair[Item] | Unpaired[Item]]:
        """Take one item in; yield what this decides, in the order of the stamps.

        Args:
            side: 'left' or 'right'.
            stamp: nanoseconds.
            item: what is to be paired.
        """
        newest = self._newest[side]
        if newest is not None and stamp < newest - RESTART:
            yield from self._abandon('the stamps jumped back')
            self.reset()
        elif newest is not None and stamp > newest:
            self._intervals.add(stamp - newest)
        waiting = self._waiting[side]
        position = bisect.bisect_left(waiting, stamp, key=lambda entry: entry[0])
        if (position < len(waiting) and waiting[position][0] == stamp) or stamp == newest:
            yield Unpaired(side, stamp, item, f'the {side} stamp was repeated', repeated=True)
            return
        self._newest[side] = max(stamp, self._newest[side] or stamp)
        waiting.insert(position, (stamp, item))
        yield from self._match(side, stamp, item)
        yield from self._expire()

    def flush(self) -> Iterator[Unpaired[Item]]:
        """Give up on all that waits, at the end of a recording."""
        yield from self._abandon('no partner')
        self.reset()

    def _match(self, side: str, stamp: int, item: Item) -> Iterator[Pair[Item]]:
        others = self._waiting['right' if side == 'left' else 'left']
        if not others:
            return
        nearest = min(others, key=lambda entry: abs(entry[0] - stamp))
        if abs(nearest[0] - stamp) > self.tolerance:
            return
        others.remove(nearest)
        self._waiting[side].remove((stamp, item))
        yield Pair(item, nearest[1]) if side == 'left' else Pair(nearest[1], item)

    def _expire(self) -> Iterator[Unpaired[Item]]:
        for side, other in (SIDES, SIDES[::-1]):
            newest = self._newest[other]
            waiting = self._waiting[side]
            while waiting and (
                len(waiting) > WAITING
                or (newest is not None and waiting[0][0] < newest - self.tolerance)
            ):
                stamp, item = waiting.pop(0)
                yield Unpaired(side, stamp, item, f'the {side} one has no partner')

    def _abandon(self, reason: str) -> Iterator[Unpaired[Item]]:
        rest = [(stamp, side, item) for side in SIDES for stamp, item in self._waiting[side]]
        for stamp, side, item in sorted(rest, key=lambda entry: entry[:2]):
            yield Unpaired(side, stamp, item, reason)
