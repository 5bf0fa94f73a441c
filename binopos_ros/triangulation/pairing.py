"""Left and right, brought together by their stamps.

A left and a right item make a pair when their stamps differ by at most the tolerance. Where no
tolerance is given it is half of the frame period, measured as the running median of the intervals
between stamps of one side.
"""

from __future__ import annotations

import bisect
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median
from typing import Generic, TypeVar

Item = TypeVar('Item')

SIDES = ('left', 'right')
#: Tolerance in nanoseconds until two stamps of one side are known.
FIRST_TOLERANCE = 5_000_000
#: A stamp that lies this many nanoseconds before its predecessor starts a new recording.
RESTART = 1_000_000_000
#: Items of one side that wait for a partner, and intervals that the period is taken from.
WAITING = 64
INTERVALS = 15


@dataclass(frozen=True)
class Pair(Generic[Item]):
    """A left and a right item of one instant."""

    left: Item
    right: Item


@dataclass(frozen=True)
class Unpaired(Generic[Item]):
    """An item that found no partner, and why."""

    side: str
    stamp: int
    item: Item
    reason: str


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
        self._intervals: deque[int] = deque(maxlen=INTERVALS)

    @property
    def tolerance(self) -> int:
        """Largest difference between the stamps of a pair now, in nanoseconds."""
        if self._given_tolerance is not None:
            return self._given_tolerance
        return int(median(self._intervals) // 2) if self._intervals else FIRST_TOLERANCE

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
            self._intervals.append(stamp - newest)
        waiting = self._waiting[side]
        position = bisect.bisect_left(waiting, stamp, key=lambda entry: entry[0])
        if (position < len(waiting) and waiting[position][0] == stamp) or stamp == newest:
            yield Unpaired(side, stamp, item, f'the {side} stamp was repeated')
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
