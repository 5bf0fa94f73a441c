"""Why something was dropped, as text that can be counted.

Reasons may quote what came in. Counted, they become keys of diagnostics and lines of reports, so
neither their number nor their length may be up to whoever sends.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

#: A stage has a dozen kinds; what goes beyond counts as one.
MOST_KINDS = 40
OTHER = 'other reasons'
LONGEST_REASON = 200
LONGEST_QUOTE = 24
#: Quotations and words keep their digits, as in 'nv12' or mono16; what else has any is a figure.
_PARTS = re.compile(
    r"(?P<quote>'[^']*')|(?P<word>(?<!\w)[A-Za-z_]\w*)|(?P<figure>-?\d+(\.\d+)?(e[-+]?\d+)?)"
)


def kind_of(reason: str) -> str:
    """The reason with its figures struck out, so that drops of one kind count together."""
    return _PARTS.sub(_kind_of_part, shown(reason))


def count_reason(counts: Counter[str], reason: str, count: int = 1) -> None:
    """Count drops of a reason, by its kind."""
    kind = kind_of(reason)
    if kind not in counts and len(counts) >= MOST_KINDS:
        kind = OTHER
    counts[kind] += count


@dataclass
class Ledger:
    """What became of the pairs that a stage took in: each gave a result or is lost, once."""

    taken: int = 0
    used: int = 0
    lost: Counter[str] = field(default_factory=Counter)

    def lose(self, reason: str) -> None:
        """Count a pair that gave nothing."""
        count_reason(self.lost, reason)

    def settle(self, reason: str = '') -> None:
        """Count a pair from its coming to its end: '' where it gave a result."""
        self.taken += 1
        if reason:
            self.lose(reason)
        else:
            self.used += 1


def shown(reason: str) -> str:
    """The reason as text of one line and of limited length."""
    if len(reason) > LONGEST_REASON:
        reason = f'{reason[:LONGEST_REASON]}...'
    return ''.join(character if character.isprintable() else '?' for character in reason)


def _kind_of_part(part: re.Match[str]) -> str:
    if part['figure']:
        return '#'
    if part['quote'] and len(part[0]) > LONGEST_QUOTE:
        return f"{part[0][:LONGEST_QUOTE]}...'"
    return part[0]
