"""The error of the room of the operator's page."""

from __future__ import annotations


class ViewError(ValueError):
    """A page that cannot be served: one line that says what, where and how to mend it."""
