"""How often something comes, and how late."""

from __future__ import annotations

from collections import deque

import numpy as np

#: s over which rates and latencies are taken.
WINDOW = 5.0
#: s; a stamp further from the clock than this is of another time, as in a bag that is played.
ANOTHER_TIME = 60.0


class Pace:
    """Arrivals of the last few seconds, and how old what arrived was."""

    def __init__(self) -> None:
        self._arrivals: deque[tuple[float, float]] = deque()

    def add(self, now: float, latency: float = float('nan')) -> None:
        """Something came at `now`, s, `latency` seconds after its stamp."""
        self._arrivals.append((now, latency))
        self._forget(now)

    def rate(self, now: float) -> float:
        """Arrivals per second (Hz)."""
        self._forget(now)
        if len(self._arrivals) < 2:
            return 0.0
        first = self._arrivals[0][0]
        # An end that waits for what does not come lowers the rate; one between two does not.
        last = max(self._arrivals[-1][0], now - (now - first) / len(self._arrivals))
        return (len(self._arrivals) - 1) / max(last - first, 1e-3)

    def latency(self, now: float) -> tuple[float, float]:
        """Median and 99th percentile, s; nan where stamps are of another time."""
        self._forget(now)
        known = [late for _, late in self._arrivals if abs(late) < ANOTHER_TIME]
        if not known:
            return float('nan'), float('nan')
        median, p99 = np.percentile(known, (50, 99))
        return float(median), float(p99)

    def _forget(self, now: float) -> None:
        while self._arrivals and self._arrivals[0][0] < now - WINDOW:
            self._arrivals.popleft()
