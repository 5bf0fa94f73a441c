"""One camera of a rig and the media it looks through: points to pixels, pixels to bent rays."""

from __future__ import annotations

import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.arithmetic import ARRAYS, FLOATS, Arithmetic, Component, NoRayError
from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.departure import Vector
from binopos_ros.optics.interface import FlatInterface, Interface
from binopos_ros.optics.paths import path_through
from binopos_ros.optics.shooting import image_plane_jacobian
from binopos_ros.optics.surfaces import Surfaces

FloatArray = NDArray[np.float64]


class Sight(NamedTuple):
    """A point's pixel and its derivatives, by component."""

    u: Component  # px
    v: Component
    u_by_point: Vector  # px/m, rig frame
    v_by_point: Vector
    u_by_index: Component  # px, per unit of the target medium's refractive index
    v_by_index: Component


class View:
    """A camera, where it stands, and the surfaces in front of it.

    Args:
        camera: the camera.
        rotation: (3, 3) camera_from_rig and
        translation: (3,) m, so that x_camera = rotation @ x_rig + translation.
        port: the camera's own port, in its frame.
        interface: the shared surface, in the rig frame.
        name: 'left' or 'right'.

    Raises:
        OpticsError: the surfaces do not fit together.

    """

    def __init__(
        self,
        camera: PinholeCamera,
        rotation: FloatArray,
        translation: FloatArray,
        port: Interface | None,
        interface: FlatInterface | None,
        name: str,
    ) -> None:
        self.camera, self.name = camera, name
        self.centre = -rotation.T @ translation
        self.surfaces = Surfaces(port, interface, rotation, translation, name)
        self._path = path_through(self.surfaces)
        self._rows = rotation.tolist()
        self._shift = translation.tolist()
        self._is_rig_frame = bool((rotation == np.eye(3)).all() and not translation.any())

    def with_target_index(self, index: float) -> View:
        """Return the view into a target medium of another index."""
        other = copy.copy(self)
        other.surfaces = self.surfaces.with_target_index(index)
        other._path = path_through(other.surfaces)
        return other

    def pixel(self, point: Vector, arithmetic: Arithmetic = ARRAYS) -> tuple[Component, Component]:
        """Project a point of the rig frame, given by components, m."""
        direction = self._path.direction(self._to_camera(point), arithmetic)
        return self.camera.pixels(*self.camera.ideal(*direction, arithmetic), arithmetic)

    def sight(self, point: Vector, arithmetic: Arithmetic = ARRAYS) -> Sight:
        """Project a point of the rig frame and differentiate its pixel, analytically."""
        departure = self._path.differentiate(self._to_camera(point), arithmetic)
        a, b = self.camera.ideal(*departure.direction, arithmetic)
        u, v, ua, ub, va, vb = self.camera.pixels_with_jacobian(a, b, arithmetic)
        # The direction (x, y, z) moves the pixel by way of a = x / z and b = y / z.
        scale = 1.0 / departure.direction[2]
        ux, uy, vx, vy = ua * scale, ub * scale, va * scale, vb * scale
        uz, vz = -(a * ux + b * uy), -(a * vx + b * vy)
        x_by, y_by, z_by = (self._to_rig(row) for row in departure.by_point)
        x_n, y_n, z_n = departure.by_target_index
        return Sight(
            u,
            v,
            _combined(ux, x_by, uy, y_by, uz, z_by),
            _combined(vx, x_by, vy, y_by, vz, z_by),
            ux * x_n + uy * y_n + uz * z_n,
            vx * x_n + vy * y_n + vz * z_n,
        )

    def ray(
        self, u: Component, v: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Vector, Vector]:
        """Trace a pixel back into the target's medium.

        Returns:
            Where the ray leaves the last surface (the camera's centre, where there is none), m,
            and its unit direction from there; rig frame, by component.

        """
        x, y = self.camera.image_plane(u, v, arithmetic)
        scale = 1.0 / arithmetic.sqrt(x * x + y * y + 1.0)
        px, py, pz, *direction = self.surfaces.trace(x * scale, y * scale, scale, arithmetic)
        sx, sy, sz = self._shift
        dx, dy, dz = direction
        return self._to_rig((px - sx, py - sy, pz - sz)), self._to_rig((dx, dy, dz))

    def reason(self, point: FloatArray) -> str:
        """Return why a point (3,) of the rig frame has no pixel; '' where it has one."""
        if not np.isfinite(point).all():
            return 'not a finite number'
        x, y, z = point.tolist()
        try:
            self.pixel((x, y, z), FLOATS)
        except NoRayError as no_ray:
            return f'{self.name}: {no_ray}'
        return ''

    def parameter_jacobian(self, points: FloatArray) -> FloatArray:
        """Differentiate the pixels with respect to the surfaces' named parameters.

        Args:
            points: (N, 3) of the rig frame, m.

        Returns:
            (N, 2, K) in px per unit, in the order of `surfaces.seeds.names`; nan without a ray.

        """
        if not self.surfaces.indices:
            return np.zeros((len(points), 2, 0))
        x, y, z = self._to_camera((points[:, 0], points[:, 1], points[:, 2]))
        a, b = self.camera.ideal(*self._path.direction((x, y, z), ARRAYS))
        _, by_parameters = image_plane_jacobian(self.surfaces, a, b, np.stack([x, y, z], axis=-1))
        _, _, ua, ub, va, vb = self.camera.pixels_with_jacobian(a, b)
        lens = np.empty((len(points), 2, 2))
        lens[:, 0, 0], lens[:, 0, 1], lens[:, 1, 0], lens[:, 1, 1] = ua, ub, va, vb
        return lens @ by_parameters

    def _to_camera(self, point: Vector) -> Vector:
        if self._is_rig_frame:
            return point
        ((a, b, c), (d, e, f), (g, h, i)), (tx, ty, tz) = self._rows, self._shift
        x, y, z = point
        return (
            a * x + b * y + c * z + tx,
            d * x + e * y + f * z + ty,
            g * x + h * y + i * z + tz,
        )

    def _to_rig(self, vector: Vector) -> Vector:
        """Rotate a direction of the camera frame, or a row of derivatives, into the rig frame."""
        if self._is_rig_frame:
            return vector
        (a, b, c), (d, e, f), (g, h, i) = self._rows
        x, y, z = vector
        return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def _combined(p: Component, x: Vector, q: Component, y: Vector, r: Component, z: Vector) -> Vector:
    return (
        p * x[0] + q * y[0] + r * z[0],
        p * x[1] + q * y[1] + r * z[1],
        p * x[2] + q * y[2] + r * z[2],
    )
