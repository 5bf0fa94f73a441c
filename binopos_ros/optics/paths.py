"""From a point to the direction in which its ray leaves the camera, through whatever lies between.

Five kinds of path, one contract (see `departure.Path`): in one medium and through planes, here;
through a dome (`dome_path.py`), and through planes behind one (`landing.py`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.aiming import aim
from binopos_ros.optics.arithmetic import FLOATS, Arithmetic, Component
from binopos_ros.optics.crossing import crossings
from binopos_ros.optics.departure import Departure, Path, Vector
from binopos_ros.optics.dome_path import DomePath
from binopos_ros.optics.landing import BehindDomePath
from binopos_ros.optics.shooting import image_plane_jacobian
from binopos_ros.optics.stack import ParallelStack
from binopos_ros.optics.surfaces import CAMERA_SIDE, MISSES_SURFACE, Surfaces

FloatArray = NDArray[np.float64]


class StraightPath:
    """One medium."""

    def direction(self, point: Vector, _: Arithmetic) -> Vector:
        """Return the point itself."""
        return point

    def differentiate(self, point: Vector, _: Arithmetic) -> Departure:
        """Return the point and the identity."""
        rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        return Departure(point, rows, (0.0, 0.0, 0.0))


class ParallelPath:
    """Parallel planes: the ray stays in a plane with the normal, and one equation gives it."""

    def __init__(self, surfaces: Surfaces) -> None:
        layers = np.diff(surfaces.offsets, prepend=0.0).tolist()
        self._stack = ParallelStack(surfaces.indices, tuple(layers))
        self._normal: Vector = tuple(surfaces.normals[0].tolist())

    def direction(self, point: Vector, arithmetic: Arithmetic) -> Vector:
        """Return normal + slope * (the point's part across the normal)."""
        height, (x, y, z), rho = self._resolve(point, arithmetic)
        slope = self._stack.slope(rho, height, arithmetic)
        nx, ny, nz = self._normal
        return nx + slope * x, ny + slope * y, nz + slope * z

    def differentiate(self, point: Vector, arithmetic: Arithmetic) -> Departure:
        """Return it with d(direction)/dX = slope (1 - n n^T) + across gradient(slope)^T."""
        height, across, rho = self._resolve(point, arithmetic)
        slope, by_rho, by_height, by_index = self._stack.bend(rho, height, arithmetic)
        (x, y, z), (nx, ny, nz) = across, self._normal
        twice = 2.0 * by_rho
        gx = twice * x + by_height * nx
        gy = twice * y + by_height * ny
        gz = twice * z + by_height * nz
        xy, xz, yz = slope * (nx * ny), slope * (nx * nz), slope * (ny * nz)
        return Departure(
            (nx + slope * x, ny + slope * y, nz + slope * z),
            (
                (slope * (1.0 - nx * nx) + x * gx, x * gy - xy, x * gz - xz),
                (y * gx - xy, slope * (1.0 - ny * ny) + y * gy, y * gz - yz),
                (z * gx - xz, z * gy - yz, slope * (1.0 - nz * nz) + z * gz),
            ),
            (by_index * x, by_index * y, by_index * z),
        )

    def _resolve(
        self, point: Vector, arithmetic: Arithmetic
    ) -> tuple[Component, Vector, Component]:
        """Return a point's height beyond the last plane, its part across the normal, and rho."""
        (x, y, z), (nx, ny, nz) = point, self._normal
        depth = x * nx + y * ny + z * nz
        height = depth - self._stack.depth
        height = arithmetic.keep(height, height > 0.0, CAMERA_SIDE)
        x, y, z = x - depth * nx, y - depth * ny, z - depth * nz
        return height, (x, y, z), x * x + y * y + z * z


class CrossingPath:
    """Planes at angles, as a housing's port before a tank's wall.

    One point goes by Newton's method on its direction, and by way of an array where that fails.
    """

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._indices = np.array(surfaces.indices)

    def direction(self, point: Vector, arithmetic: Arithmetic) -> Vector:
        """Return the point where the ray crosses the first plane, or the direction with z = 1."""
        aimed = aim(self._surfaces, point) if arithmetic is FLOATS else None
        if aimed is not None:
            return aimed.a, aimed.b, 1.0
        surfaces, targets = self._surfaces, _rows(point)
        normals, offsets = surfaces.normals, surfaces.offsets
        known = np.isfinite(targets).all(axis=1)
        beyond = known & (targets @ normals[-1] > offsets[-1])
        # Rays that cannot exist are solved for a harmless stand-in and not kept.
        safe = np.where(beyond[:, None], targets, 2.0 * offsets[-1] * normals[-1])
        x = crossings(normals, offsets, surfaces.bases, self._indices, safe)
        legs = np.diff(x, axis=1, prepend=0.0, append=safe[:, None])
        ahead = np.einsum('nmi,mi->nm', legs[:, :-1], normals) > 0.0
        ahead &= np.einsum('nmi,mi->nm', legs[:, 1:], normals) > 0.0
        in_order = ahead.all(axis=1)
        (vx, vy, vz) = x[:, 0].T
        if arithmetic is FLOATS:
            vx, vy, vz = x[0, 0].tolist()
            beyond, in_order = beyond[0], in_order[0]
        vz = arithmetic.keep(vz, beyond, CAMERA_SIDE)
        return vx, vy, arithmetic.keep(vz, in_order, MISSES_SURFACE)

    def differentiate(self, point: Vector, arithmetic: Arithmetic) -> Departure:
        """Return the direction scaled to z = 1, and its derivatives by shooting."""
        aimed = aim(self._surfaces, point) if arithmetic is FLOATS else None
        if aimed is not None:
            return aimed.departure
        vx, vy, vz = self.direction(point, arithmetic)
        a, b = vx / vz, vy / vz
        by_target, by_parameters = image_plane_jacobian(
            self._surfaces, np.atleast_1d(a), np.atleast_1d(b), _rows(point)
        )
        jacobian = np.concatenate([by_target, by_parameters[:, :, :1]], axis=2)
        parts = np.moveaxis(jacobian, 0, -1)
        if arithmetic is FLOATS:
            parts = parts[..., 0].tolist()
        (ax, ay, az, an), (bx, by, bz, bn) = parts
        rows = ((ax, ay, az), (bx, by, bz), (0.0, 0.0, 0.0))
        return Departure((a, b, 1.0 + 0.0 * a), rows, (an, bn, 0.0))


def path_through(surfaces: Surfaces) -> Path:
    """Return the path that these surfaces make."""
    if not surfaces.indices:
        return StraightPath()
    if surfaces.spheres and surfaces.planes:
        return BehindDomePath(surfaces)
    if surfaces.spheres:
        return DomePath(surfaces.spheres, surfaces.indices)
    return ParallelPath(surfaces) if surfaces.parallel else CrossingPath(surfaces)


def _rows(point: Vector) -> FloatArray:
    x, y, z = np.atleast_1d(*point)
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)
