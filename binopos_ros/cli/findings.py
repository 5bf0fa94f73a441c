"""What a check found, and the remedy."""

from __future__ import annotations

from dataclasses import dataclass

OK, NOTE, WARNING, FAULT = range(4)
_MARKS = ('ok     ', 'note   ', 'warning', 'FAULT  ')


@dataclass(frozen=True)
class Finding:
    """One line for the user: how bad, about what, what, and what to do about it."""

    level: int
    subject: str
    text: str
    remedy: str = ''

    def __str__(self) -> str:
        line = f'{_MARKS[self.level]} {self.subject}: {self.text}'
        return f'{line}\n        -> {self.remedy}' if self.remedy else line
