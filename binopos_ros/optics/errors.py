"""The optics room's one exception."""

from __future__ import annotations


class OpticsError(ValueError):
    """A camera, an interface or a calibration file that cannot be what it claims to be."""
