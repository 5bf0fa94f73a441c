"""Whether a node still answers, by the beats that it sends through a pipe."""

from __future__ import annotations

import os
from pathlib import Path

#: Seconds without a beat after which a node is looked at; it beats five times a second.
SILENCE = 1.2
#: Seconds of processor time without a beat after which a node runs in circles: a slow machine may
#: work for seconds on a new calibration.
CIRCLING = 5.0
#: Looks, and seconds from the first to the last of them, at which a silent node only waits.
LOOKS, LOOKING = 3, 0.4
TICKS = os.sysconf('SC_CLK_TCK')


class Pulse:
    """The beats of one process.

    A machine that is busy elsewhere keeps a node from beating too. So a silent node counts as hung
    only where it is stopped or waits though it could run, or has used the processor for long.

    Args:
        descriptor: the pipe's end to read from, which does not block; it is closed with `close`.
        pid: of the process.
    """

    def __init__(self, descriptor: int, pid: int) -> None:
        self._descriptor = descriptor
        self._process = Path('/proc') / str(pid)
        self._last: float | None = None
        self._used = 0.0
        self._idle: list[float] = []

    @property
    def is_up(self) -> bool:
        """Whether it has ever beaten."""
        return self._last is not None

    def trouble(self, now: float) -> str:
        """What keeps the process from answering, '' while it does or only starts.

        Args:
            now: seconds of `time.monotonic`.
        """
        if self._has_beaten():
            self._last, self._used, self._idle = now, self._processor_time(), []
        if self._last is None or now - self._last < SILENCE:
            return ''
        states = self._states()
        silent = f'has not answered for {now - self._last:.1f} s'
        if not states or 't' in states:
            # Gone, which shows elsewhere, or in a debugger's hands.
            return ''
        if states & {'R', 'D'}:
            used = self._processor_time() - self._used
            return f'{silent}, and was busy for {used:.1f} s of it' if used > CIRCLING else ''
        self._idle.append(now)
        if len(self._idle) < LOOKS or now - self._idle[0] < LOOKING:
            return ''
        return f'{silent}: it {"is stopped" if "T" in states else "only waits"}'

    def close(self) -> None:
        """Listen no more."""
        os.close(self._descriptor)

    def _has_beaten(self) -> bool:
        try:
            return bool(os.read(self._descriptor, 1 << 16))
        except BlockingIOError:
            return False

    def _states(self) -> set[str]:
        """The states of its threads, as proc(5) writes them."""
        states = set()
        for stat in self._process.glob('task/*/stat'):
            try:
                states.add(stat.read_text().rpartition(')')[2].split()[0])
            except OSError:
                continue
        return states

    def _processor_time(self) -> float:
        try:
            fields = (self._process / 'stat').read_text().rpartition(')')[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / TICKS
