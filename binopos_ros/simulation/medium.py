"""Light through layered media, ray by ray: Snell's law in vector form at each boundary.

Rays start at the camera and are traced backwards, which is the same path: light is reversible.
Boundaries are stated in the rig's frame: planes, of which the first may carry waves, and the
spheres of a dome, which hold the camera.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.simulation.waves import WaveField

Array = NDArray[np.float64]

MAX_SURFACE_STEPS = 12
#: Newton's steps end when they get shorter than this, m, by the precision of the waves' sines.
SURFACE_TOLERANCE: dict[type[np.floating[Any]], float] = {np.float64: 1e-11, np.float32: 1e-7}


@dataclasses.dataclass(frozen=True)
class Boundary:
    """A plane between two media, perhaps with waves on it.

    Attributes:
        normal: (3,) unit, rig frame, pointing away from the cameras.
        distance: of the plane from the rig's origin along the normal, m.
        index_before, index_after: refractive indices on the cameras' side and beyond.
        waves: height of the surface over the plane, towards the cameras; None where it is flat.
    """

    normal: Array
    distance: float
    index_before: float
    index_after: float
    waves: WaveField | None = None

    def axes(self) -> tuple[Array, Array]:
        """Two unit vectors that span the plane; the waves' x and y."""
        return plane_axes(self.normal)

    def is_passed(self, points: Array) -> NDArray[np.bool_]:
        """Which of points (N, 3) lie beyond it."""
        passed: NDArray[np.bool_] = dot(points, self.normal) > self.distance
        return passed

    def calm(self) -> Boundary:
        """The same without waves."""
        return dataclasses.replace(self, waves=None)

    def meet(self, points: Array, directions: Array, time: ArrayLike) -> tuple[Array, Array]:
        """Where rays meet it, and the unit normals there."""
        return _meet(self, points, directions, time)


@dataclasses.dataclass(frozen=True)
class Sphere:
    """One side of a dome's wall.

    Attributes:
        centre: (3,) m, rig frame.
        radius: m.
        index_before, index_after: refractive indices inside and outside.
    """

    centre: Array
    radius: float
    index_before: float
    index_after: float

    def is_passed(self, points: Array) -> NDArray[np.bool_]:
        """Which of points (N, 3) lie beyond it."""
        offset = points - self.centre
        passed: NDArray[np.bool_] = dot(offset, offset) > self.radius**2
        return passed

    def calm(self) -> Sphere:
        """The same: no waves run on glass."""
        return self

    def meet(self, points: Array, directions: Array, _: ArrayLike) -> tuple[Array, Array]:
        """Where rays from inside meet it, and the unit normals there."""
        offset = points - self.centre
        along = dot(offset, directions)
        # Both roots of |offset + s direction| = radius; a ray from inside has one ahead of it.
        steps = np.sqrt(along**2 + self.radius**2 - dot(offset, offset)) - along
        hits = points + steps[:, None] * directions
        return hits, (hits - self.centre) / self.radius


@dataclasses.dataclass(frozen=True)
class Rays:
    """Rays in the last medium.

    Attributes:
        origins: (N, 3) where each ray enters the last medium, m.
        directions: (N, 3) unit; nan where total reflection stops the light.
        entries: (N, 3) where each ray meets the first boundary, m.
        lengths: (N,) path from there to `origins`, m.
    """

    origins: Array
    directions: Array
    entries: Array
    lengths: Array


def plane_axes(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors that with the normal make a right-handed frame, the first nearest to x."""
    reference = np.array([1.0, 0, 0]) if abs(normal[0]) < 0.9 else np.array([0, 1.0, 0])
    first = reference - normal * (normal @ reference)
    first /= np.sqrt(first @ first)
    return first, np.cross(normal, first)


def trace(
    boundaries: tuple[Boundary | Sphere, ...], origin: Array, directions: Array, time: ArrayLike
) -> Rays:
    """Follow rays from one point through all boundaries.

    Args:
        boundaries: in the order in which the rays meet them; none leaves the rays as they are.
        origin: (3,) where the rays start, m.
        directions: (N, 3) unit.
        time: s, one or (N,), for the waves.
    """
    points = np.broadcast_to(origin, directions.shape)
    entries = points
    lengths = np.zeros(len(directions))
    for number, boundary in enumerate(boundaries):
        hits, normals = boundary.meet(points, directions, time)
        if number == 0:
            entries = hits
        else:
            lengths = lengths + np.sqrt(dot(hits - points, hits - points))
        directions = refract(directions, normals, boundary.index_before / boundary.index_after)
        points = hits
    return Rays(points, directions, entries, lengths)


def refract(directions: Array, normals: Array, ratio: float) -> Array:
    """Snell's law: unit directions beyond a boundary; nan at total reflection or from behind.

    Args:
        directions: (N, 3) unit, arriving.
        normals: (3,) or (N, 3) unit, on the side towards which the rays go.
        ratio: index before over index after.
    """
    cosine = dot(directions, normals)
    remaining = 1 - ratio**2 * (1 - cosine**2)
    passes = (remaining >= 0) & (cosine > 0)
    along = np.where(passes, np.sqrt(np.where(passes, remaining, 0)) - ratio * cosine, np.nan)
    return ratio * directions + along[:, None] * normals


def meet_plane(rays: Rays, point: Array, normal: Array) -> tuple[Array, Array]:
    """Where rays in the last medium meet a plane.

    Returns:
        (N, 3) the places from the plane's point, m, and (N,) the way there, m: 0 where a ray never
        arrives.
    """
    offset = rays.origins - point
    towards = dot(rays.directions, normal)
    valid = np.isfinite(towards) & (np.abs(towards) > 1e-9)
    steps = np.where(valid, -dot(offset, normal) / np.where(valid, towards, 1), 0.0)
    hits = offset + steps[:, None] * np.where(valid[:, None], rays.directions, 0)
    return hits, np.maximum(steps, 0)


def _meet(
    boundary: Boundary, points: Array, directions: Array, time: ArrayLike
) -> tuple[Array, Array]:
    """Where rays meet a boundary, and the unit normals there."""
    normal = boundary.normal
    towards = dot(directions, normal)
    height = boundary.distance - dot(points, normal)
    # A ray that flies parallel or away never arrives.
    arrives = towards > 1e-9
    steps = np.where(arrives, height / np.where(arrives, towards, 1.0), np.nan)
    if boundary.waves is None:
        return points + steps[:, None] * directions, np.broadcast_to(normal, points.shape)
    first, second = boundary.axes()
    x0, dx = dot(points, first), dot(directions, first)
    y0, dy = dot(points, second), dot(directions, second)
    tolerance = SURFACE_TOLERANCE[boundary.waves.precision]
    # Newton on f(s) = n.(p + s d) - distance + height(x(s), y(s)).
    for _ in range(MAX_SURFACE_STEPS):
        wave, slope_x, slope_y = boundary.waves.height_and_slope(
            x0 + steps * dx, y0 + steps * dy, time
        )
        change = (steps * towards - height + wave) / (towards + slope_x * dx + slope_y * dy)
        steps = steps - change
        if not np.any(np.abs(change) > tolerance):
            break
    normals = normal + slope_x[:, None] * first + slope_y[:, None] * second
    normals /= np.sqrt(dot(normals, normals))[:, None]
    return points + steps[:, None] * directions, normals


def dot(a: Array, b: Array) -> Array:
    """Scalar products of (..., 3) vectors."""
    # Term by term, so that the sum is the same whatever the batch, the BLAS and its threads.
    product = a * b
    return product[..., 0] + product[..., 1] + product[..., 2]
