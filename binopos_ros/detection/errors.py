"""The room's error class."""

from __future__ import annotations


class DetectionError(ValueError):
    """An image or an option that the detector cannot use; the message says which and why."""


class UnreadableError(DetectionError):
    """The data of a picture are corrupt: nothing is known of what it shows."""
