"""A stereo rig that looks through flat interfaces into another medium (Eq. 4-5, 8-12)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.camera import PinholeCamera, components
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import FlatInterface
from binopos_ros.optics.stack import ParallelStack

FloatArray = NDArray[np.float64]


class StereoRig:
    """Two cameras, and what lies between them and the target.

    The rig frame is the left camera's optical frame.

    Args:
        left: the left camera.
        right: the right camera.
        rotation: (3, 3) and
        translation: (3,) m, so that x_right = rotation @ x_left + translation.
        interface: a surface both look through, in the rig frame.
        left_port: the left camera's own port, in its frame; in front of the interface, if any.
        right_port: the right camera's own port, in its frame.

    Raises:
        OpticsError: the parts do not fit together.

    """

    def __init__(
        self,
        left: PinholeCamera,
        right: PinholeCamera,
        rotation: ArrayLike,
        translation: ArrayLike,
        interface: FlatInterface | None = None,
        left_port: FlatInterface | None = None,
        right_port: FlatInterface | None = None,
    ) -> None:
        self.left, self.right = left, right
        self.rotation = np.array(rotation, dtype=float)
        self.translation = np.array(translation, dtype=float).ravel()
        self.interface, self.left_port, self.right_port = interface, left_port, right_port

    def project(self, points: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Project points of the rig frame along the bent rays.

        Args:
            points: (N, 3) or (3,), m.

        Returns:
            Left and right pixels, (N, 2) or (2,) each; nan where no ray exists.

        """
        points = components(points, 3, 'points')
        return (
            self._view(self.left, np.eye(3), np.zeros(3), self.left_port, points),
            self._view(self.right, self.rotation, self.translation, self.right_port, points),
        )

    def _view(
        self,
        camera: PinholeCamera,
        rotation: FloatArray,
        translation: FloatArray,
        port: FlatInterface | None,
        points: FloatArray,
    ) -> FloatArray:
        points = points @ rotation.T + translation
        surfaces: list[tuple[FloatArray, float, FlatInterface]] = []
        if port is not None:
            surfaces.append((port.normal, port.distance, port))
        if self.interface is not None:
            normal = rotation @ self.interface.normal
            surfaces.append(
                (normal, self.interface.distance + float(normal @ translation), self.interface)
            )
        if not surfaces:
            return camera.project(points)
        if len(surfaces) == 2:
            msg = 'a port and a shared interface together are not supported yet'
            raise OpticsError(msg)
        normal, distance, surface = surfaces[0]
        stack = ParallelStack(surface.indices, (distance, *surface.thicknesses))
        z = points @ normal
        across = points - z[..., None] * normal
        with np.errstate(all='ignore'):
            height = np.where(z > stack.depth, z - stack.depth, np.nan)
            slope = stack.slope((across * across).sum(axis=-1), height)
            return camera.project(normal + slope[..., None] * across)
