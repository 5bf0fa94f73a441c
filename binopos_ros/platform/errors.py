"""The error of this room."""

from __future__ import annotations


class PlatformError(ValueError):
    """A transform or an odometry that cannot be, or options that do not fit together."""
