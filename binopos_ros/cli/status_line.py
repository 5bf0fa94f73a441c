"""One calm line that updates in a terminal; elsewhere a line per second."""

from __future__ import annotations

import sys
import time

TERMINAL_PERIOD = 0.1
PLAIN_PERIOD = 1.0


class StatusLine:
    """Shows the newest text on stdout, at a pace that a person can read."""

    def __init__(self) -> None:
        self._is_terminal = sys.stdout.isatty()
        self._period = TERMINAL_PERIOD if self._is_terminal else PLAIN_PERIOD
        self._next = 0.0
        self._shown = ''

    def show(self, text: str) -> None:
        """Show a text, unless the one before is too recent or the same."""
        now = time.monotonic()
        if not text or text == self._shown or now < self._next:
            return
        self._next = now + self._period
        self._shown = text
        print(f'\r\x1b[K{text}' if self._is_terminal else text, end=self._end, flush=True)

    def end(self) -> None:
        """Leave the line, so that what follows stands on its own."""
        if self._is_terminal and self._shown:
            print()

    @property
    def _end(self) -> str:
        return '' if self._is_terminal else '\n'
