"""Why something was dropped, as text that can be counted."""

from __future__ import annotations

import re

_FIGURES = re.compile(r'-?\d+(\.\d+)?(e[-+]?\d+)?')


def kind_of(reason: str) -> str:
    """The reason with its figures struck out, so that drops of one kind count together."""
    return _FIGURES.sub('#', reason)
