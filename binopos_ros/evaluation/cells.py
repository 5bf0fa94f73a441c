"""Tables of words and figures: each figure is kept as a number, and knows how it is shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

#: From here on figures are shown by their power of ten.
LARGE = 1e4


class Value(NamedTuple):
    """A figure, and the digits after the point that are shown of it."""

    value: float
    digits: int = 2

    def __str__(self) -> str:
        shown = f'{self.value:.{self.digits}f}'
        return shown if abs(self.value) < LARGE else f'{self.value:.1e}'


class Span(NamedTuple):
    """From one figure to another."""

    low: float
    high: float
    digits: int = 2

    def __str__(self) -> str:
        return f'{self.low:.{self.digits}f} .. {self.high:.{self.digits}f}'


#: '' stands for what is not known.
Cell = str | Value | Span


class Table(NamedTuple):
    """A table with a name for its file, a title, and what to know when reading it.

    Every column of figures says its unit; those without one are counts, shares or indices.
    """

    name: str
    title: str
    header: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    note: str = ''
