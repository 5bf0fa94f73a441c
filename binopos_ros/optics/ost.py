"""The oST text format, version 5.0: sections in brackets, titles in them, numbers under these."""

from __future__ import annotations


def is_ost(text: str) -> bool:
    """Tell whether a file begins like oST text."""
    first = next((line.strip() for line in text.splitlines() if line.strip()), '')
    return first.startswith(('# oST', '['))


def sections(text: str) -> list[tuple[str, dict[str, list[str]]]]:
    """Return the sections in order: their names, and the words under each of their titles."""
    found: list[tuple[str, dict[str, list[str]]]] = []
    words: list[str] = []
    for raw in text.splitlines():
        line = raw.strip()
        if not line or line.startswith('#'):
            continue
        if line.startswith('[') and line.endswith(']'):
            found.append((line[1:-1].strip(), {}))
        elif found and line[0].isalpha():
            words = found[-1][1].setdefault(line, [])
        elif found and found[-1][1]:
            words += line.split()
    return found
