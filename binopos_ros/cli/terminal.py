"""Text that fits the terminal it is read in."""

from __future__ import annotations

import shutil
import sys
import textwrap

HANGING = 4


def fitted(text: object) -> str:
    """The lines folded at blanks to the terminal's width; in a pipe, as they are.

    Programs that read a line find all of it there.
    """
    if not sys.stdout.isatty():
        return str(text)
    width = shutil.get_terminal_size().columns
    return '\n'.join(_folded(line, width) for line in str(text).split('\n'))


def _folded(line: str, width: int) -> str:
    indent = len(line) - len(line.lstrip()) + HANGING
    return textwrap.fill(
        line,
        width,
        subsequent_indent=' ' * min(indent, width // 2),
        break_long_words=False,
        break_on_hyphens=False,
    )
