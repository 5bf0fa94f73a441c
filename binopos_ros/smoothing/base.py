"""The shell that every filter shares: stamps, bad measurements, late ones, starting afresh.

A filter proper is four pure functions on its own *memory*, a NamedTuple of arrays that are never
written into: start, advance, correct, estimate. So a prediction changes nothing, and a late
measurement is filed in exactly, by going back to the memory before it and taking the later ones
again. All four take leading dimensions: a batch of sequences in lock-step costs little more than
one, which is what makes tuning affordable.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from typing import Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.motion import Seconds
from binopos_ros.smoothing.options import Options, build
from binopos_ros.smoothing.state import FilterState, unknown_state

Array = NDArray[np.float64]
MemoryT = TypeVar('MemoryT')

#: Positions (m) and deviations beyond this are nonsense, and would overflow.
FARTHEST = 1e6
#: A covariance whose determinant is below this part of its diagonal's product is singular.
SINGULAR = 1e-10
#: Why a filter itself refused a position.
OUTSIDE = 'the position does not belong to the cloud of the others (its certainty is 0)'
#: A longer pause (s) between refused positions ends the run that could start the filter afresh.
RUN_PAUSE = 0.5
#: No prediction ages a state by more (s): by then nothing is known, and powers stay finite.
LONGEST_PREDICTION = 1e5


class Estimate(NamedTuple):
    """Position, velocity (..., 3), their covariance (..., 6, 6), the last measurement's weight.

    A weight of 0 says that the measurement was not used.
    """

    position: Array
    velocity: Array
    covariance: Array
    certainty: Array | float


class _Taken(NamedTuple):
    """A measurement that went through the filter, and the memory after it."""

    stamp: float
    position: Array
    covariance: Array
    memory: Any


class _Run(NamedTuple):
    """Refused positions that agree with each other: where a new track may begin."""

    since: float
    stamp: float
    position: Array


class Filter(ABC, Generic[MemoryT]):
    """A smoother of stamped 3-D positions; see :meth:`step`.

    Raises :class:`SmoothingError` for an unknown option or one out of range; later only for arrays
    of other shapes.
    """

    name: ClassVar[str]
    options_class: ClassVar[type[Options]] = Options

    def __init__(self, **options: Any) -> None:
        self.options = build(self.options_class, self.name, options)
        self.reset()

    def __repr__(self) -> str:
        given = ', '.join(f'{name}={value!r}' for name, value in vars(self.options).items())
        return f'{type(self).__name__}({given})'

    def reset(self) -> None:
        """Forget all measurements; the options stay."""
        self._memory: MemoryT | None = None
        self._stamp = -math.inf
        self._used_stamp = -math.inf
        self._run: _Run | None = None
        self._taken: deque[_Taken] = deque(maxlen=64)

    def step(
        self,
        stamp: float,
        position: ArrayLike,
        covariance: ArrayLike,
        medium: ArrayLike | None = None,
    ) -> FilterState:
        """Take one measurement in and return the state at the newest stamp.

        Parameters
        ----------
        stamp : float
            Instant of the measurement (s). Irregular and late stamps are welcome.
        position : (3,) array
            Measured position (m).
        covariance : (3, 3) array
            Its covariance (m^2): noise that differs from frame to frame, the medium's included.
        medium : (3, 3) array, optional
            The part of that covariance that a waving surface makes (m^2).

        Returns
        -------
        FilterState
            `reason` says why the measurement was not used; the state is then the prediction.

        Raises
        ------
        SmoothingError
            The position or the covariance has another shape.

        """
        # Copies: a late measurement takes them in again, and the caller may reuse its arrays.
        measured = np.array(position, dtype=np.float64)
        spread = np.array(covariance, dtype=np.float64)
        waving = None if medium is None else np.array(medium, dtype=np.float64)
        if not math.isfinite(stamp):
            return self._say(self._stamp, 'the stamp is not finite')
        reason = _why_bad(measured, spread)
        if not reason and waving is not None:
            reason = _why_no_part(waving, spread)
        if reason:
            return self._say(stamp, reason)
        spread = self.spread(spread, waving)
        if self._memory is None:
            return self._begin(stamp, measured, spread)
        elapsed = stamp - self._stamp
        if elapsed <= 0.0:
            return self._take_late(stamp, measured, spread)
        if stamp - self._used_stamp > self.options.max_gap:
            return self._begin(stamp, measured, spread)
        since_used = stamp - self._used_stamp
        memory, reason = self._pass(self._memory, elapsed, since_used, measured, spread)
        if memory is None:
            return self._refuse(stamp, measured, spread, reason)
        self._keep(stamp, measured, spread, memory)
        estimate = self._estimate(memory)
        if estimate.certainty == 0.0:
            return self._refuse(stamp, measured, spread, OUTSIDE)
        self._used_stamp = stamp
        self._run = None
        return _state(stamp, estimate)

    def predict(self, stamp: float) -> FilterState:
        """Return the state foretold for `stamp` (s) without changing the filter.

        A stamp that is not finite or lies before the newest measurement gives the state there.
        """
        if not math.isfinite(stamp):
            return self._say(self._stamp, 'the stamp is not finite')
        if stamp < self._stamp:
            return self._say(stamp, 'the stamp lies before the newest measurement')
        return self._say(stamp, '')

    @property
    def has_velocity(self) -> bool:
        """Whether it has seen more than one measurement since it began: one tells no velocity."""
        return len(self._taken) > 1

    def spread(self, covariance: Array, medium: Array | None = None) -> Array:
        """Return what the filter makes of a covariance (..., 3, 3) and the medium's part of it.

        One that knows nothing of waves takes what is left without them, as it was tuned.
        """
        return covariance if medium is None else covariance - medium

    @abstractmethod
    def _start(self, position: Array, covariance: Array) -> MemoryT:
        """Return the memory after a first measurement."""

    @abstractmethod
    def _advance(self, memory: MemoryT, elapsed: Seconds) -> MemoryT:
        """Return the memory `elapsed` seconds later, without a measurement."""

    @abstractmethod
    def _correct(self, memory: MemoryT, position: Array, covariance: Array) -> MemoryT:
        """Return the memory after a measurement at its stamp."""

    @abstractmethod
    def _estimate(self, memory: MemoryT) -> Estimate:
        """Return what the memory says of the target."""

    def _place(self, memory: MemoryT) -> Array:
        """Return the estimate's position alone, which some filters have more cheaply."""
        return self._estimate(memory).position

    def _say(self, stamp: float, reason: str) -> FilterState:
        if self._memory is None:
            return unknown_state(
                stamp if math.isfinite(stamp) else 0.0, reason or 'no measurement yet'
            )
        elapsed = stamp - self._stamp
        if elapsed <= 0.0:
            estimate = self._estimate(self._memory)
            stamp = self._stamp
        else:
            elapsed = min(elapsed, LONGEST_PREDICTION)
            estimate = self._estimate(self._advance(self._memory, elapsed))
        return FilterState(stamp, *estimate[:3], 0.0, reason)

    def _begin(self, stamp: float, position: Array, covariance: Array) -> FilterState:
        self.reset()
        memory = self._start(position, covariance)
        self._keep(stamp, position, covariance, memory)
        self._used_stamp = stamp
        return _state(stamp, self._estimate(memory))

    def _keep(self, stamp: float, position: Array, covariance: Array, memory: MemoryT) -> None:
        self._memory = memory
        self._stamp = stamp
        self._taken.append(_Taken(stamp, position, covariance, memory))

    def _pass(
        self,
        memory: MemoryT,
        elapsed: float,
        since_used: float,
        position: Array,
        covariance: Array,
    ) -> tuple[MemoryT | None, str]:
        """Return the memory after a measurement, or none and why it was out of reach."""
        memory = self._advance(memory, elapsed)
        reach = self.options.max_jump + self.options.max_speed * since_used
        distance = math.dist(position.tolist(), self._place(memory).tolist())
        if distance > reach:
            far = f'the position lies {distance:.3g} m from the prediction'
            return None, f'{far}, beyond the {reach:.3g} m that are in reach'
        return self._correct(memory, position, covariance), ''

    def _refuse(
        self, stamp: float, position: Array, covariance: Array, reason: str
    ) -> FilterState:
        """Report a refused position; start afresh where a run of them agrees with itself."""
        run = self._run
        agrees = (
            run is not None
            and 0.0 < stamp - run.stamp <= RUN_PAUSE
            and math.dist(position, run.position)
            <= 0.25 * self.options.max_jump + self.options.max_speed * (stamp - run.stamp)
        )
        self._run = _Run(run.since if run is not None and agrees else stamp, stamp, position)
        if stamp - self._run.since >= self.options.reacquire_after and agrees:
            return self._begin(stamp, position, covariance)
        return self._say(stamp, reason)

    def _take_late(self, stamp: float, position: Array, covariance: Array) -> FilterState:
        """File a late measurement in at its own stamp and take the later ones again."""
        delay = self._stamp - stamp
        if any(item.stamp == stamp for item in self._taken):
            return self._say(stamp, f'the stamp {stamp:.6f} s was already used')
        earlier = [item for item in self._taken if item.stamp < stamp]
        if delay > self.options.max_delay or not earlier:
            reason = f'the stamp lies {delay:.3g} s before the newest one'
            return self._refuse(stamp, position, covariance, reason)
        later = [item for item in self._taken if item.stamp > stamp]
        for _ in later:
            self._taken.pop()
        memory, newest, late_reason = earlier[-1].memory, earlier[-1].stamp, ''
        for item in [_Taken(stamp, position, covariance, None), *later]:
            elapsed = item.stamp - newest
            after, reason = self._pass(memory, elapsed, elapsed, item.position, item.covariance)
            if after is not None:
                memory, newest = after, item.stamp
                self._taken.append(item._replace(memory=memory))
                reason = '' if self._estimate(memory).certainty > 0.0 else OUTSIDE
            if item.stamp == stamp:
                late_reason = reason
        self._memory, self._stamp = memory, newest
        return _state(newest, self._estimate(memory), late_reason)


def _state(stamp: float, estimate: Estimate, reason: str = '') -> FilterState:
    return FilterState(stamp, *estimate[:3], float(estimate.certainty), reason)


def _why_no_part(medium: Array, covariance: Array) -> str:
    """Return what is wrong with the medium's part of a covariance, or ''."""
    if medium.shape != (3, 3):
        return f"the medium's covariance has shape {medium.shape}, not (3, 3)"
    numbers = medium.ravel().tolist()
    parts, totals = numbers[::4], covariance.ravel().tolist()[::4]
    whole = math.isfinite(sum(numbers))
    if not whole or any(not 0.0 <= part < all_ for part, all_ in zip(parts, totals, strict=True)):
        return "the medium's covariance is no part of the position's"
    return ''


def _why_bad(position: Array, covariance: Array) -> str:
    """Return what is wrong with a measurement in itself, or ''; in plain floats, for speed."""
    if position.shape != (3,):
        raise SmoothingError(f'the position has shape {position.shape}, not (3,)')
    if covariance.shape != (3, 3):
        raise SmoothingError(f'the covariance has shape {covariance.shape}, not (3, 3)')
    x, y, z = position.tolist()
    if not math.isfinite(x + y + z):
        return 'the position is not finite'
    if max(abs(x), abs(y), abs(z)) > FARTHEST:
        return f'the position lies beyond {FARTHEST:.0e} m'
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = covariance.tolist()
    total = xx + xy + xz + yx + yy + yz + zx + zy + zz
    if not math.isfinite(total):
        return 'the covariance is not finite'
    if abs(xy - yx) + abs(xz - zx) + abs(yz - zy) > 1e-6 * (abs(xx) + abs(yy) + abs(zz)):
        return 'the covariance is not symmetric'
    if min(xx, yy, zz) < 0.0:
        return 'the covariance is negative'
    if max(xx, yy, zz) > FARTHEST * FARTHEST:
        return f'the covariance says more than {FARTHEST:.0e} m'
    minor = xx * yy - xy * xy
    # A variance below 1e-18 m^2 is a nanometre: no measurement, and it would underflow.
    if min(xx, yy, zz) < 1e-18:
        return 'the covariance is singular'
    determinant = zz * minor - xx * yz * yz - yy * xz * xz + 2.0 * xy * yz * xz
    if minor < 0.0 or determinant < -SINGULAR * xx * yy * zz:
        return 'the covariance is negative'
    if determinant <= SINGULAR * xx * yy * zz:
        return 'the covariance is singular'
    return ''
