"""Pictures as they arrive live: brought together by their stamps before anything is decoded.

What is worked on next is the newest pair. One that was overtaken while the one before it was being
worked on is left out whole, so that a short processor gives fewer poses and not older ones. Each
picture, and each pair, ends in a result or in one reason, and both are counted.

A picture whose partner does not come is worked on alone: its centroid is of use to who looks
through one camera. It waits for its partner for two frame periods, and not at all behind a camera
that is silent.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.parameters import ParameterError, check_options, option
from binopos_ros.reasons import Ledger
from binopos_ros.sides import SIDES

Item = TypeVar('Item')

TRANSPORTS = ('auto', 'compressed', 'raw')
OVERTAKEN = 'overtaken by a newer pair'
#: Seconds that a picture waits for its partner while the frame period is not known.
FIRST_PATIENCE = 0.1
#: Works that wait where none may be left out; who brings more has to wait.
MOST_READY = 32


@dataclass(frozen=True)
class ArrivalOptions:
    """Which pictures are taken, and in what order. Raises ParameterError for a wrong value."""

    image_transport: Literal['auto', 'compressed', 'raw'] = option(
        'auto',
        'Which pictures to take where a driver sends them twice; auto: compressed where they are '
        'there',
        choices=TRANSPORTS,
        read_only=True,
    )
    pair_tolerance: float = option(
        0.0,
        'Largest difference between the stamps of a pair, as the triangulator has it; 0 takes '
        'half of the frame period',
        's',
        (0.0, 10.0),
        read_only=True,
    )
    newest_first: bool = option(
        True,
        'Leave pairs out that newer ones have overtaken; false: work on every pair, however late',
        read_only=True,
    )

    def __post_init__(self) -> None:
        check_options(self, ParameterError)


@dataclass(eq=False)
class Picture(Generic[Item]):
    """One picture on its way: what arrived, and what became of it.

    `item` is None once the picture is settled; `outcome` is None before, '' where it gave a
    result, and otherwise the reason why not.
    """

    side: str
    stamp: int
    item: Item | None
    arrived: float
    partner: Picture[Item] | None = None
    unpaired: str = ''
    given: bool = False
    outcome: str | None = None


Work = tuple[Picture[Item], ...]


class Arrivals(Generic[Item]):
    """Pictures of both cameras, in, and what is to be worked on next, out; for two threads.

    Args:
        options: see there.
        clock: seconds, of the machine's own time.

    Attributes:
        pairs: what became of pairs.
        unpaired: pictures that found no partner, by side.
    """

    def __init__(
        self, options: ArrivalOptions, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.pairs = Ledger()
        self.unpaired: Counter[str] = Counter()
        self._newest_first = options.newest_first
        self._clock = clock
        tolerance = options.pair_tolerance
        self._matcher: PairMatcher[Picture[Item]] = PairMatcher(
            round(tolerance * 1e9) if tolerance > 0 else None
        )
        self._held: dict[str, deque[Picture[Item]]] = {side: deque() for side in SIDES}
        self._alone = dict.fromkeys(SIDES, False)
        self._ready: deque[Work[Item]] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def add(self, side: str, stamp: int, item: Item) -> list[Picture[Item]]:
        """Take one picture in.

        Returns the pictures that are left out by it, settled.

        Args:
            side: 'left' or 'right'.
            stamp: nanoseconds.
            item: what is to be worked on.
        """
        with self._changed:
            picture = Picture(side, stamp, item, self._clock())
            if stamp == 0:
                return [
                    self._left_out(picture, "the stamp is zero: the camera's driver sets none")
                ]
            self._alone['right' if side == 'left' else 'left'] = False
            self._held[side].append(picture)
            gone: list[Picture[Item]] = []
            for event in self._matcher.add(side, stamp, picture):
                if isinstance(event, Pair):
                    gone += self._join(event.left, event.right)
                elif event.repeated:
                    self._held[side].remove(picture)
                    gone.append(self._left_out(picture, 'the stamp was repeated'))
                else:
                    gone += self._part(event.item)
            if self._alone[side]:
                gone += self._release(side)
            self._wait_for_room()
            return gone

    def look(self) -> list[Picture[Item]]:
        """Give up waiting for partners that are overdue; as `add`.

        To be called again and again by who calls `add`, so that a partner that has come and was
        not taken in yet does not count as overdue.
        """
        with self._changed:
            now, patience = self._clock(), self._patience()
            gone: list[Picture[Item]] = []
            for side, held in self._held.items():
                if held and now - held[0].arrived > patience:
                    self._alone[side] = True
                    gone += self._release(side)
            return gone

    def take(self) -> Work[Item] | None:
        """Wait for what is to be worked on next: a pair, or single ones; None after `close`."""
        with self._changed:
            while not self._ready:
                if self._closed:
                    return None
                self._changed.wait()
            work = self._ready.popleft()
            if len(work) == 1 and self._ready and len(self._ready[0]) == 1:
                other = self._ready[0][0]
                if other.side != work[0].side:
                    self._ready.popleft()
                    work = (work[0], other)
            self._changed.notify_all()
            return work

    def settle(self, picture: Picture[Item], outcome: str) -> None:
        """Say what became of a picture: '' where it gave a result, or the reason why not."""
        with self._changed:
            self._settle(picture, outcome)

    def close(self) -> None:
        """Let nobody wait any more."""
        with self._changed:
            self._closed = True
            self._ready.clear()
            self._changed.notify_all()

    def _patience(self) -> float:
        period = self._matcher.period
        return FIRST_PATIENCE if period is None else 2e-9 * period

    def _join(self, left: Picture[Item], right: Picture[Item]) -> list[Picture[Item]]:
        self.pairs.taken += 1
        left.partner, right.partner = right, left
        fresh = tuple(each for each in (left, right) if not each.given)
        for each in fresh:
            self._held[each.side].remove(each)
        self._close_pair(left)
        return self._offer(fresh)

    def _part(self, picture: Picture[Item]) -> list[Picture[Item]]:
        self.unpaired[picture.side] += 1
        picture.unpaired = 'no partner'
        if picture.given:
            return []
        self._held[picture.side].remove(picture)
        if self._newest_first and self._is_newer_ready(picture):
            return [self._left_out(picture, picture.unpaired)]
        return self._offer((picture,))

    def _is_newer_ready(self, picture: Picture[Item]) -> bool:
        return any(
            each.side == picture.side and each.stamp > picture.stamp
            for work in self._ready
            for each in work
        )

    def _release(self, side: str) -> list[Picture[Item]]:
        """Work on what waits for a partner without it; where it comes later, it is a pair yet."""
        gone: list[Picture[Item]] = []
        while self._held[side]:
            gone += self._offer((self._held[side].popleft(),))
        return gone

    def _offer(self, work: Work[Item]) -> list[Picture[Item]]:
        gone: list[Picture[Item]] = []
        if not work:
            return gone
        for each in work:
            each.given = True
        if self._newest_first:
            sides = {each.side for each in work}
            kept: deque[Work[Item]] = deque()
            for older in self._ready:
                if {each.side for each in older} <= sides:
                    gone += [self._left_out(each, each.unpaired or OVERTAKEN) for each in older]
                else:
                    kept.append(older)
            self._ready = kept
        self._ready.append(work)
        self._changed.notify_all()
        return gone

    def _wait_for_room(self) -> None:
        while not self._newest_first and len(self._ready) > MOST_READY and not self._closed:
            self._changed.wait()

    def _left_out(self, picture: Picture[Item], reason: str) -> Picture[Item]:
        self._settle(picture, reason)
        return picture

    def _settle(self, picture: Picture[Item], outcome: str) -> None:
        picture.outcome, picture.item = outcome, None
        self._close_pair(picture)

    def _close_pair(self, picture: Picture[Item]) -> None:
        other = picture.partner
        if other is None or picture.outcome is None or other.outcome is None:
            return
        picture.partner = other.partner = None
        left, right = (picture, other) if picture.side == 'left' else (other, picture)
        failed = [each for each in (left, right) if each.outcome]
        if not failed:
            self.pairs.used += 1
        elif left.outcome == right.outcome == OVERTAKEN:
            self.pairs.lose(OVERTAKEN)
        else:
            self.pairs.lose(f'{failed[0].side}: {failed[0].outcome}')
