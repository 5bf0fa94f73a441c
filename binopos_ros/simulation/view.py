"""One camera in the scene: its lens, its place, and the media it looks through."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import DomePort, FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.lens import BROWN, EQUIDISTANT
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.lens import Lens
from binopos_ros.simulation.medium import Boundary, Rays, Sphere, dot, plane_axes, trace
from binopos_ros.simulation.waves import WaveField
from binopos_ros.simulation.wide_lens import WideLens

Array = NDArray[np.float64]

NEWTON_STEPS = 25
#: Step of the finite differences, in tangents of the viewing angle.
DIFFERENCE = 1e-6
LENSES: dict[str, type[Lens] | type[WideLens]] = {BROWN: Lens, EQUIDISTANT: WideLens}


@dataclasses.dataclass(frozen=True)
class View:
    """A camera in the rig's frame.

    Attributes:
        lens: the camera's own model.
        centre: (3,) of projection, m.
        rotation: (3, 3) rig_from_camera.
        boundaries: between the camera and the target's medium, nearest first.
    """

    lens: Lens | WideLens
    centre: Array
    rotation: Array
    boundaries: tuple[Boundary | Sphere, ...]

    def directions(self, pixels: ArrayLike) -> Array:
        """(N, 2) pixels to (N, 3) unit directions in the rig's frame."""
        return _turn(self.rotation, self.lens.directions(pixels))

    def look(self, pixels: ArrayLike, time: ArrayLike) -> Rays:
        """Follow the light of (N, 2) pixels backwards to the target's medium."""
        return trace(self.boundaries, self.centre, self.directions(pixels), time)

    def apparent(self, points: ArrayLike, times: ArrayLike) -> Array:
        """Pixels at which points are seen: the backward trace, iterated until it meets each point.

        Newton's method on the two tangents of the viewing direction, from the straight one; at
        each step the ray's miss is measured in the plane through the point.

        Args:
            points: (N, 3) m, rig frame.
            times: (N,) s, or one, for the waves.

        Returns:
            (N, 2) px; nan for points that are not in the last medium, and where no ray was found,
            as beyond a caustic or at total reflection. A pixel may lie outside the image.
        """
        points = np.atleast_2d(np.asarray(points, float))
        times = np.broadcast_to(np.asarray(times, float), points.shape[:1])
        last = self.boundaries[-1] if self.boundaries else None
        normal = last.normal if isinstance(last, Boundary) else self.rotation[:, 2]
        straight = _turn(self.rotation.T, points - self.centre)
        seen = straight[:, 2] > 0
        if last is not None:
            seen &= last.is_passed(points)
        tangents = np.full((len(points), 2), np.nan)
        tangents[seen] = straight[seen, :2] / straight[seen, 2:]
        active = np.flatnonzero(seen)
        solved = np.zeros(len(points), bool)
        for _ in range(NEWTON_STEPS):
            if active.size == 0:
                break
            count = active.size
            # The point itself and its two neighbours for the differences, in one batch.
            probes = np.concatenate([tangents[active]] * 3)
            probes[count : 2 * count, 0] += DIFFERENCE
            probes[2 * count :, 1] += DIFFERENCE
            miss = self._miss(
                probes, np.tile(points[active], (3, 1)), np.tile(times[active], 3), normal
            )
            here = miss[:count]
            columns = (miss[count:].reshape(2, count, 2) - here) / DIFFERENCE
            determinant = columns[0, :, 0] * columns[1, :, 1] - columns[0, :, 1] * columns[1, :, 0]
            fine = np.isfinite(determinant) & (determinant != 0)
            active, here, columns, determinant = (
                active[fine],
                here[fine],
                columns[:, fine],
                determinant[fine],
            )
            step = np.stack(
                [
                    columns[1, :, 1] * here[:, 0] - columns[1, :, 0] * here[:, 1],
                    columns[0, :, 0] * here[:, 1] - columns[0, :, 1] * here[:, 0],
                ],
                axis=1,
            )
            step /= determinant[:, None]
            length = np.sqrt(step[:, 0] ** 2 + step[:, 1] ** 2)
            # A long step leaves the region in which the surface is one smooth lens.
            step *= np.minimum(1, 0.3 / np.maximum(length, 1e-300))[:, None]
            tangents[active] -= step
            done = length < 1e-10
            solved[active[done]] = True
            active = active[~done]
        pixels = np.full((len(points), 2), np.nan)
        rays = np.column_stack([tangents[solved], np.ones(solved.sum())])
        pixels[solved] = self.lens.pixels(rays)
        return pixels

    def _miss(self, tangents: Array, points: Array, times: Array, normal: Array) -> Array:
        """(N, 2) by how much the traced rays pass the points, m."""
        norm = np.sqrt(tangents[:, 0] ** 2 + tangents[:, 1] ** 2 + 1)
        camera = np.column_stack([tangents, np.ones(len(tangents))]) / norm[:, None]
        rays = trace(self.boundaries, self.centre, _turn(self.rotation, camera), times)
        offset = rays.origins - points
        towards = dot(rays.directions, normal)
        valid = np.isfinite(towards) & (np.abs(towards) > 1e-9)
        steps = np.where(valid, -dot(offset, normal) / np.where(valid, towards, 1), np.nan)
        miss = offset + steps[:, None] * rays.directions
        first, second = plane_axes(normal)
        return np.stack([dot(miss, first), dot(miss, second)], axis=1)


def views_of(rig: StereoRig, waves: WaveField | None = None) -> tuple[View, View]:
    """The left and the right camera of a rig, with the waves on its shared surface.

    Raises:
        SimulationError: waves without a shared surface.
    """
    if waves is not None and rig.interface is None:
        msg = 'waves need a water surface: this rig looks through ports or through air alone'
        raise SimulationError(msg)
    left = _view(rig.left, np.eye(3), np.zeros(3), rig.left_port, rig.interface, waves)
    rotation = np.asarray(rig.rotation, float)
    centre = -rotation.T @ np.asarray(rig.translation, float).ravel()
    right = _view(rig.right, rotation.T, centre, rig.right_port, rig.interface, waves)
    return left, right


def _view(
    camera: PinholeCamera,
    rotation: Array,
    centre: Array,
    port: Interface | None,
    interface: FlatInterface | None,
    waves: WaveField | None,
) -> View:
    boundaries: list[Boundary | Sphere] = []
    if isinstance(port, DomePort):
        boundaries += _spheres(port, centre + rotation @ port.centre)
    elif isinstance(port, FlatInterface):
        normal = rotation @ np.asarray(port.normal, float)
        boundaries += _boundaries(port, normal, float(port.distance + normal @ centre), None)
    if interface is not None:
        normal = np.asarray(interface.normal, float)
        boundaries += _boundaries(interface, normal, float(interface.distance), waves)
    for boundary in boundaries[:1]:
        if boundary.is_passed(centre[None])[0]:
            msg = (
                f'a camera at {np.round(centre, 4).tolist()} m lies beyond its interface: '
                'give the interface a larger distance'
            )
            raise SimulationError(msg)
    size = (int(camera.size[0]), int(camera.size[1]))
    lens = LENSES[camera.model](camera.matrix, camera.distortion, size)
    return View(lens, centre, rotation, tuple(boundaries))


def _spheres(dome: DomePort, centre: Array) -> list[Sphere]:
    radii = dome.radius, dome.radius + dome.thickness
    return [
        Sphere(centre, radius, float(dome.indices[number]), float(dome.indices[number + 1]))
        for number, radius in enumerate(radii)
    ]


def _boundaries(
    interface: FlatInterface, normal: Array, distance: float, waves: WaveField | None
) -> list[Boundary]:
    depths = np.concatenate([[0.0], np.cumsum(interface.thicknesses)])
    return [
        Boundary(
            normal,
            distance + float(depth),
            float(interface.indices[number]),
            float(interface.indices[number + 1]),
            waves if number == 0 else None,
        )
        for number, depth in enumerate(depths)
    ]


def _turn(rotation: Array, directions: Array) -> Array:
    # Written out, so that no BLAS decides on the order of the sum.
    x, y, z = directions[:, 0], directions[:, 1], directions[:, 2]
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in rotation], axis=1)
