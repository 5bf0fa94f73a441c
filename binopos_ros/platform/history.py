"""What is known of one moving transform: samples by stamp, interpolated between, never beyond."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import NamedTuple

from binopos_ros.platform.noise import ORDER, Measure, SampleNoise
from binopos_ros.platform.quaternions import conjugate, product, rotation_vector
from binopos_ros.platform.transforms import Transform, between

#: Samples older than this, ns, are forgotten: no position is as late.
KEPT = 10_000_000_000
#: A stamp that lies so far, ns, behind the newest one is of a clock that was set back.
RESTART = 1_000_000_000
SECOND = 1e-9


class Limits(NamedTuple):
    """Between which samples nothing is interpolated: `gap` s apart, or faster than can be."""

    gap: float
    speed: float  #: m/s
    turn_rate: float  #: rad/s


class Missing(NamedTuple):
    """Why there is no pose for a stamp, and whether waiting may help."""

    reason: str
    may_come: bool


class Bracket(NamedTuple):
    """The two samples about a stamp (ns), as indices, and where between them it lies, 0 to 1."""

    first: int
    second: int
    weight: float


class History:
    """Samples of a moving transform in the order of their stamps.

    Args:
        name: what moves, for reasons.
        limits: between which samples nothing is interpolated.
    """

    def __init__(self, name: str, limits: Limits) -> None:
        self._name = name
        self._limits = limits
        self.stamps: list[int] = []
        self.transforms: list[Transform] = []
        #: How the samples up to each one differed from a smooth motion.
        self.measures: list[Measure | None] = []
        self._noise = SampleNoise()

    def add(self, stamp: int, transform: Transform) -> tuple[int, str]:
        """Take a sample in; where it was put, -1 where it was refused or known, and why."""
        if self.stamps and stamp < self.stamps[-1] - RESTART:
            self.clear()
        at = bisect_right(self.stamps, stamp)
        if at and self.stamps[at - 1] == stamp:
            same = self.transforms[at - 1] == transform
            return -1, '' if same else f'{self._name} is told twice for one stamp, differently'
        self.stamps.insert(at, stamp)
        self.transforms.insert(at, transform)
        if at == len(self.stamps) - 1:
            newest = slice(-ORDER - 1, None)
            measure = self._noise.add(self.stamps[newest], self.transforms[newest])
        else:
            measure = self.measures[at - 1] if at else None
        self.measures.insert(at, measure)
        return at, ''

    def clear(self) -> None:
        """Forget all samples."""
        self.stamps.clear()
        self.transforms.clear()
        self.measures.clear()
        self._noise.reset()

    def too_old(self) -> int:
        """How many samples from the front may go; 0 until it is worth while."""
        if not self.stamps or self.stamps[-1] - self.stamps[0] < 2 * KEPT:
            return 0
        return bisect_right(self.stamps, self.stamps[-1] - KEPT)

    def drop_oldest(self, count: int) -> None:
        """Forget so many samples from the front."""
        del self.stamps[:count]
        del self.transforms[:count]
        del self.measures[:count]

    def bracket(self, stamp: int) -> Bracket | Missing:
        """The samples about a stamp (ns), or why there are none that can be used."""
        stamps = self.stamps
        if not stamps:
            return Missing(f'{self._name} has not come yet', may_come=True)
        after = bisect_right(stamps, stamp)
        if after and stamps[after - 1] == stamp:
            return Bracket(after - 1, after - 1, 0.0)
        if after == len(stamps):
            late = (stamp - stamps[-1]) * SECOND
            return Missing(f'{self._name} ends {late:.3f} s before the image', may_come=True)
        if after == 0:
            early = (stamps[0] - stamp) * SECOND
            return Missing(f'{self._name} begins {early:.3f} s after the image', may_come=False)
        span = (stamps[after] - stamps[after - 1]) * SECOND
        if span > self._limits.gap:
            return Missing(
                f'{self._name} has a gap of {span:.3f} s about the image, more than '
                f"'platform.max_gap'",
                may_come=False,
            )
        problem = self._jump(self.transforms[after - 1], self.transforms[after], span)
        if problem:
            return Missing(problem, may_come=False)
        weight = (stamp - stamps[after - 1]) * SECOND / span
        return Bracket(after - 1, after, weight)

    def at(self, bracket: Bracket) -> Transform:
        """The transform at a bracket; a weight a little outside of 0 to 1 goes on as it went."""
        first = self.transforms[bracket.first]
        if bracket.first == bracket.second:
            return first
        return between(first, self.transforms[bracket.second], bracket.weight)

    def span(self, bracket: Bracket) -> float:
        """Seconds between the samples of a bracket; of a single one, to its neighbour."""
        first = bracket.first
        second = first + 1 if bracket.second == first else bracket.second
        if second == len(self.stamps):
            first, second = first - 1, second - 1
        return (self.stamps[second] - self.stamps[first]) * SECOND if first >= 0 else 0.0

    def _jump(self, first: Transform, second: Transform, span: float) -> str:
        way = math.dist(first.translation, second.translation)
        if way > self._limits.speed * span:
            return f'{self._name} jumps by {way:.3f} m in {span:.3f} s about the image'
        turn = math.hypot(*rotation_vector(product(second.rotation, conjugate(first.rotation))))
        if turn > self._limits.turn_rate * span:
            return f'{self._name} jumps by {turn:.3f} rad in {span:.3f} s about the image'
        return ''
