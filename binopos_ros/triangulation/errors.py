"""The one exception of this room."""

from __future__ import annotations


class TriangulationError(ValueError):
    """Bad input to triangulation or to the index's estimate: what, where, how to mend it."""
