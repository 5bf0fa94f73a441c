"""From a point to the direction in which its ray leaves the camera: what every path gives.

All in the camera's frame: `direction(point)` is a vector along the ray at the camera's centre;
`differentiate(point)` gives it with its derivatives by the point and by the refractive index of
the target's medium.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from binopos_ros.optics.arithmetic import Arithmetic, Component

Vector = tuple[Component, Component, Component]


class Departure(NamedTuple):
    """A ray's direction at the camera, and its derivatives."""

    direction: Vector
    by_point: tuple[Vector, Vector, Vector]  # rows: d(direction component)/d(x, y, z)
    by_target_index: Vector


class Path(Protocol):
    """What a view asks of the media in front of its camera."""

    def direction(self, point: Vector, arithmetic: Arithmetic) -> Vector:
        """Return a vector along the ray at the camera's centre."""

    def differentiate(self, point: Vector, arithmetic: Arithmetic) -> Departure:
        """Return it with its derivatives."""
