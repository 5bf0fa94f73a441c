"""How far a verb is: a bar in a terminal, a line per ten seconds in a pipe or a file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

TERMINAL_PERIOD = 0.1
PLAIN_PERIOD = 10.0
WIDTH = 30
#: Seconds of steps from which a pace can be told.
SETTLING = 1.0


@contextmanager
def progress(label: str, steps: int) -> Iterator[Callable[[], None]]:
    """Call what it gives once for each of `steps` steps; all goes to stderr.

    What takes less than ten seconds says nothing in a pipe.
    """
    bar = _Bar(label, steps)
    try:
        yield bar.step
    finally:
        bar.end()


@contextmanager
def working(label: str) -> Iterator[None]:
    """Say in a terminal, on stderr, what is at work that cannot tell how far it is."""
    is_terminal = sys.stderr.isatty()
    if is_terminal:
        print(f'{label} ...', end='', file=sys.stderr, flush=True)
    try:
        yield
    finally:
        if is_terminal:
            print('\r\x1b[K', end='', file=sys.stderr, flush=True)


class _Bar:
    def __init__(self, what: str, total: int) -> None:
        self._what = what
        self._total = max(total, 1)
        self._done = 0
        self._is_terminal = sys.stderr.isatty()
        self._period = TERMINAL_PERIOD if self._is_terminal else PLAIN_PERIOD
        self._next = time.monotonic() + self._period
        self._first: float | None = None

    def step(self) -> None:
        """Count one step, and show it where it is time to."""
        self._done += 1
        now = time.monotonic()
        if self._first is None:
            self._first = now
        if now >= self._next:
            self._next = now + self._period
            self._show(now)

    def end(self) -> None:
        """Take the bar away."""
        if self._is_terminal:
            print('\r\x1b[K', end='', file=sys.stderr, flush=True)

    def _show(self, now: float) -> None:
        share = min(self._done / self._total, 1.0)
        told = f'{self._done} of {self._total}{self._left(now)}'
        if self._is_terminal:
            bar = '#' * round(WIDTH * share)
            line = f'\r\x1b[K{self._what} [{bar:<{WIDTH}}] {told}'
            print(line, end='', file=sys.stderr, flush=True)
        else:
            print(f'{self._what}: {told}', file=sys.stderr, flush=True)

    def _left(self, now: float) -> str:
        """The time that is left at the pace since the first step, once that has settled.

        What comes before the first step, as opening a file, is done once.
        """
        assert self._first is not None
        gone, steps = now - self._first, self._done - 1
        if gone < SETTLING or not steps:
            return ''
        return f', {_clock(gone * max(self._total - self._done, 0) / steps)} left'


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f'{minutes}:{rest:02d}'
