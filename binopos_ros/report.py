"""What came out of a bag: pairs seen and used, drops by reason, latency, error against truth."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from binopos_ros.pairing import Pair, PairMatcher, Unpaired
from binopos_ros.pipeline import Dropped, Event, Located
from binopos_ros.reasons import count_reason
from binopos_ros.smoothing.stage import LATE

MILLI = 1e3


class Track:
    """Stamped positions, nanoseconds and (3,) m, kept in 32 bytes each."""

    def __init__(self) -> None:
        self.stamps = array('q')
        self._coordinates = array('d')

    def add(self, stamp: int, point: NDArray[np.float64]) -> None:
        """Append one position."""
        self.stamps.append(stamp)
        self._coordinates.extend(point)

    @property
    def points(self) -> NDArray[np.float64]:
        """(N, 3) m."""
        return np.array(self._coordinates).reshape(-1, 3)

    def errors(self, truth: Track) -> NDArray[np.float64]:
        """(N, 3) m: these positions minus the truth at their stamps, where the truth is known."""
        if not self.stamps or not truth.stamps:
            return np.empty((0, 3))
        known = np.array(truth.stamps)
        order = np.argsort(known)
        # Stamps since 1970 have more digits than a float.
        origin = known[order[0]]
        stamps = (np.array(self.stamps) - origin).astype(float)
        known = (known[order] - origin).astype(float)
        inside = (stamps >= known[0]) & (stamps <= known[-1])
        places = truth.points[order]
        expected = np.column_stack([np.interp(stamps, known, places[:, k]) for k in range(3)])
        errors: NDArray[np.float64] = (self.points - expected)[inside]
        return errors


@dataclass
class Fates:
    """What became of pairs, by the stamps of what was dropped and of the poses.

    Args:
        tolerance: largest difference between the stamps of a pair, nanoseconds; None takes half of
            the frame period.
    """

    tolerance: int | None = None
    pairs: list[tuple[int, int]] = field(default_factory=list)
    unpaired: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        self._matcher: PairMatcher[int] = PairMatcher(self.tolerance)
        self._reasons: dict[int, list[tuple[int, str]]] = {}
        self._told = 0

    @classmethod
    def within(cls, seconds: float | None) -> Fates:
        """The fates of pairs whose stamps differ so much at most; 0 and None: see `tolerance`."""
        return cls(round(seconds * 1e9) if seconds else None)

    def saw(self, side: str, stamp: int) -> None:
        """Take a picture's stamp in, nanoseconds."""
        self._sort(self._matcher.add(side, stamp, stamp))

    def end(self) -> None:
        """Give up on pictures that still wait for a partner."""
        self._sort(self._matcher.flush())

    def drop(self, stamp: int, reason: str) -> None:
        """Take in why something of that stamp was dropped; of a pair the first reason counts."""
        self._told += 1
        self._reasons.setdefault(stamp, []).append((self._told, reason))

    def lost(self, poses: Collection[int]) -> Counter[str]:
        """Why pairs gave no pose: each counts for one reason, and is left out where it gave one.

        Args:
            poses: stamps of the poses, nanoseconds.
        """
        lost: Counter[str] = Counter()
        for _, reason in self.lost_pairs(poses):
            count_reason(lost, reason)
        return lost

    def lost_pairs(self, poses: Collection[int]) -> Iterator[tuple[int, str]]:
        """The left stamps (ns) of pairs that gave no pose, and why; `poses` as `lost` has them."""
        given = set(poses)
        for left, right in self.pairs:
            if left not in given:
                told = self._reasons.get(left, []) + self._reasons.get(right, [])
                yield left, min(told)[1] if told else LATE

    def alone(self) -> Counter[str]:
        """Why something was dropped that is of no pair."""
        paired = {stamp for pair in self.pairs for stamp in pair}
        counts: Counter[str] = Counter()
        for stamp, told in self._reasons.items():
            if stamp not in paired:
                for _, reason in told:
                    count_reason(counts, reason)
        return counts

    def _sort(self, events: Iterable[Pair[int] | Unpaired[int]]) -> None:
        for event in events:
            if isinstance(event, Pair):
                self.pairs.append((event.left, event.right))
            else:
                self.unpaired[event.side] += 1


@dataclass
class Report:
    """The table that `replay` and `process` end with.

    The pairs seen are the poses and the pairs dropped, one reason each. `drops` are counted by the
    live nodes; offline they follow from `fates`.
    """

    drops: Counter[str] = field(default_factory=Counter)
    #: What was left out that is no pair of pictures: damaged messages, transforms.
    others: Counter[str] = field(default_factory=Counter)
    fates: Fates = field(default_factory=Fates)
    latencies: array[float] = field(default_factory=lambda: array('d'))
    raw: Track = field(default_factory=Track)
    filtered: Track = field(default_factory=Track)
    truth: Track = field(default_factory=Track)
    fixed_truth: Track = field(default_factory=Track)
    fixed_frame: str = ''
    interrupted: bool = False
    parameters: Sequence[str] = ()
    notes: Counter[str] = field(default_factory=Counter)

    @property
    def seen(self) -> int:
        """Pairs that the rig took, by the stamps of its pictures."""
        return len(self.fates.pairs)

    def add(self, event: Event) -> None:
        """Count what the pipeline made of an image."""
        if isinstance(event, Dropped):
            if event.of_pair:
                self.fates.drop(event.stamp, event.reason)
            else:
                count_reason(self.others, event.reason)
        elif isinstance(event, Located):
            self.raw.add(event.position.stamp, event.position.point)
            if event.pose is not None:
                self.filtered.add(event.pose.stamp, event.pose.state.position)

    def conclude(self) -> None:
        """Count the pairs that gave no pose, once nothing more is added."""
        self.fates.end()
        self.drops += self.fates.lost(self.filtered.stamps)
        self.others += self.fates.alone()

    def note(self, line: str) -> None:
        """Say something of the bag, with its count where it is said again."""
        self.notes[line] += 1

    def drop(self, reason: str, count: int = 1) -> None:
        """Count pairs that gave no pose; figures in the reason do not part it from its like."""
        count_reason(self.drops, reason, count)

    def __str__(self) -> str:
        rows = [
            *[
                ('note', line if count == 1 else f'{line} ({count} times)')
                for line, count in self.notes.items()
            ],
            ('parameters', ', '.join(['defaults', *self.parameters])),
            ('pairs seen', str(self.seen)),
            ('pairs used', str(len(self.raw.stamps))),
            ('poses', str(len(self.filtered.stamps))),
            *[(f'dropped: {reason}', str(count)) for reason, count in self.drops.most_common()],
        ]
        if not self.drops:
            rows.append(('dropped', '0'))
        rows += [
            (f'{side} pictures without a partner', str(count))
            for side, count in sorted(self.fates.unpaired.items())
        ]
        rows += [(f'left out: {reason}', str(count)) for reason, count in self.others.items()]
        if self.latencies:
            median, high = np.percentile(self.latencies, [50, 99]) * MILLI
            rows.append(('latency from stamp to pose, median', f'{median:.1f} ms'))
            rows.append(('latency from stamp to pose, 99th percentile', f'{high:.1f} ms'))
        fixed = bool(self.fixed_frame)
        truth = self.fixed_truth if fixed else self.truth
        for name, errors in (
            ('target/position', self.raw.errors(self.truth)),
            ('target/pose', self.filtered.errors(truth)),
        ):
            if len(errors):
                rows.append((f'error of {name} against truth, RMS', _rms_text(errors)))
        if self.interrupted:
            rows.append(('interrupted', 'before the end of the bag'))
        elif not truth.stamps:
            name = 'truth/fixed_pose' if fixed else 'truth/pose'
            rows.append(('error against truth', f'the bag holds no {name}'))
        if fixed:
            rows.append(('frame of target/pose', self.fixed_frame))
        width = max(len(name) for name, _ in rows)
        return '\n'.join(f'  {name:<{width}}  {value}' for name, value in rows)


def rms(errors: NDArray[np.float64]) -> float:
    """Root of the mean squared length of (N, 3) errors, m."""
    return float(np.sqrt((errors**2).sum(axis=1).mean()))


def _rms_text(errors: NDArray[np.float64]) -> str:
    x, y, z = np.sqrt((errors**2).mean(axis=0)) * MILLI
    return f'{rms(errors) * MILLI:.3f} mm (x {x:.3f}, y {y:.3f}, z {z:.3f})'
