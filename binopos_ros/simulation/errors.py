"""What the simulator refuses."""

from __future__ import annotations


class SimulationError(ValueError):
    """A scene that cannot be rendered, with what is wrong and how to mend it."""
