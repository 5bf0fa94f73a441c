"""The error of this room."""

from __future__ import annotations


class CalibrationError(ValueError):
    """Bad calibration input: one line that says what, where, and how to mend it."""
