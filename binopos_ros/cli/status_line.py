"""One calm line that is updated in place in a terminal; elsewhere a line per ten seconds."""

from __future__ import annotations

import shutil
import sys
import time

TERMINAL_PERIOD = 0.25
PLAIN_PERIOD = 10.0
CLEAR = '\r\x1b[K'
CUT = '\u2026'


class StatusLine:
    """Shows the newest text on stdout, at a pace that a person can read."""

    def __init__(self) -> None:
        self._is_terminal = sys.stdout.isatty()
        self._period = TERMINAL_PERIOD if self._is_terminal else PLAIN_PERIOD
        self._next = 0.0
        self._shown = ''

    def show(self, text: str) -> None:
        """Show a text, unless the one before is too recent; in a terminal, unless it is there."""
        now = time.monotonic()
        if not text or now < self._next:
            return
        self._next = now + self._period
        if not self._is_terminal:
            print(text, flush=True)
        elif text != self._shown:
            self._shown = text
            print(f'{CLEAR}{_cut(text)}', end='', flush=True)

    def report(self, text: str) -> None:
        """Say something on stderr, in the place of the line, which comes again by itself."""
        if self._shown:
            self._shown = ''
            print(CLEAR, end='', flush=True)
        print(text, file=sys.stderr)

    def end(self) -> None:
        """Leave the line, so that what follows stands on its own."""
        if self._shown:
            print()


def _cut(text: str) -> str:
    """What fits into one row: of one that is folded only the last row would be updated."""
    width = shutil.get_terminal_size().columns - 1
    return text if len(text) <= width else f'{text[: width - 1]}{CUT}'
