"""What the evaluation refuses."""

from __future__ import annotations


class EvaluationError(ValueError):
    """An evaluation that cannot be made, with what is wrong and how to mend it."""
