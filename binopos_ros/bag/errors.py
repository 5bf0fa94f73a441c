"""The error of the room of bags."""

from __future__ import annotations


class BagError(ValueError):
    """A bag that cannot be read or written: one line that says what, where and how to mend it."""
