"""The refracting surfaces in front of one camera, in its own frame, in the order of the light.

A camera may look through its own port, through a shared surface, or through both. Here they
become one list of spheres, of planes and of media, together with how each surface and index
answers to the named parameters of the interfaces. Only a port may be a dome, so spheres come
first.
"""

from __future__ import annotations

import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.arithmetic import ARRAYS, Arithmetic, Component
from binopos_ros.optics.departure import Vector
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import TARGET_INDEX, FlatInterface, Interface, Walls, tangents

FloatArray = NDArray[np.float64]

PARALLEL = 1e-12  # rad; below this two normals are one
CAMERA_SIDE = 'on the camera side of the last surface'
TOTAL_REFLECTION = 'total reflection'
MISSES_SURFACE = 'the ray does not reach the surfaces in their order'


Row = tuple[float, float, float, float, float]


class Seeds(NamedTuple):
    """Derivatives of surfaces and indices with respect to K named parameters."""

    names: tuple[str, ...]
    vectors: FloatArray  # (surfaces, 3, K) of normals, or centres
    extents: FloatArray  # (surfaces, K) of offsets, or radii
    indices: FloatArray  # (surfaces + 1, K)


class Surfaces:
    """Spheres and planes of one camera's frame, nearest first, and the media they part.

    Attributes:
        spheres: (x, y, z, radius, index before / index beyond) of each, as floats, m.
        planes: (x, y, z, offset, index before / index beyond) of each, as floats.
        normals: (planes, 3) and
        offsets: (planes,) m, of the planes alone.

    Args:
        port: the camera's own port, in its frame.
        interface: the shared surface, in the rig frame.
        rotation: (3, 3) camera_from_rig and
        translation: (3,) m, so that x_camera = rotation @ x_rig + translation.
        name: of the camera, 'left' or 'right', for messages and for the port's parameters.

    Raises:
        OpticsError: the surfaces do not fit one another or the camera.

    """

    def __init__(
        self,
        port: Interface | None,
        interface: FlatInterface | None,
        rotation: FloatArray,
        translation: FloatArray,
        name: str,
    ) -> None:
        self._parts: list[tuple[str, Interface, Walls]] = []
        self.indices: tuple[float, ...] = ()
        if port is not None:
            self._parts.append((f'{name}_port', port, port.walls(np.eye(3), np.zeros(3))))
            self.indices = port.indices
        if interface is not None:
            walls = interface.walls(rotation, translation)
            if walls.extents[0] <= 0.0:
                msg = (
                    f"the {name} camera lies {-walls.extents[0]:g} m beyond the interface's first"
                    ' surface; where each camera looks through a wall of its own, these are its '
                    'left_port and right_port (calibrate interface --ports)'
                )
                raise OpticsError(msg)
            self._parts.append(('interface', interface, walls))
            self.indices = _joined(self.indices, interface.indices, name)
        curved = [walls for *_, walls in self._parts if walls.curved]
        flat = [walls for *_, walls in self._parts if not walls.curved]
        self.normals = np.array([row for walls in flat for row in walls.vectors]).reshape(-1, 3)
        self.offsets = np.array([d for walls in flat for d in walls.extents])
        self.parallel = not curved and self._are_parallel()
        reaches = (self.parallel and (np.diff(self.offsets) <= 0.0).any()) or any(
            (self.normals @ walls.vectors[-1] + walls.extents[-1] >= self.offsets).any()
            for walls in curved
        )
        if reaches:
            msg = f"the {name} camera's port reaches beyond the interface; mend their distances"
            raise OpticsError(msg)
        ratios = [a / b for a, b in zip(self.indices[:-1], self.indices[1:], strict=True)]
        count = sum(len(walls.extents) for walls in curved)
        self.spheres = _rows(curved, ratios[:count])
        self.planes = _rows(flat, ratios[count:])

    def _are_parallel(self) -> bool:
        if not len(self.normals):
            return True
        return float(np.linalg.norm(self.normals - self.normals[0], axis=1).max()) < PARALLEL

    def trace(
        self, ux: Component, uy: Component, uz: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component, Component, Component, Component, Component]:
        """Follow unit rays from the camera's centre into the target's medium (Snell, Eq. 8).

        Returns:
            The points where they leave the last surface, m, and their unit directions beyond it,
            by component; where a ray is totally reflected or misses a surface it is not kept.

        """
        sqrt, keep = arithmetic.sqrt, arithmetic.keep
        x = y = z = 0.0 * ux
        for cx, cy, cz, radius, ratio in self.spheres:
            # The ray comes from inside, so it meets the sphere once, ahead.
            rx, ry, rz = x - cx, y - cy, z - cz
            along = rx * ux + ry * uy + rz * uz
            half = sqrt(radius * radius - (rx * rx + ry * ry + rz * rz) + along * along)
            reach = half - along
            x, y, z = x + reach * ux, y + reach * uy, z + reach * uz
            cosine = half / radius
            square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
            square = keep(square, square > 0.0, TOTAL_REFLECTION)
            bend = (sqrt(square) - ratio * cosine) / radius
            ux = ratio * ux + bend * (x - cx)
            uy = ratio * uy + bend * (y - cy)
            uz = ratio * uz + bend * (z - cz)
        for nx, ny, nz, offset, ratio in self.planes:
            cosine = ux * nx + uy * ny + uz * nz
            cosine = keep(cosine, cosine > 0.0, MISSES_SURFACE)
            reach = (offset - (x * nx + y * ny + z * nz)) / cosine
            reach = keep(reach, reach > 0.0, MISSES_SURFACE)
            x, y, z = x + reach * ux, y + reach * uy, z + reach * uz
            square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
            square = keep(square, square > 0.0, TOTAL_REFLECTION)
            along = sqrt(square) - ratio * cosine
            ux, uy, uz = ratio * ux + along * nx, ratio * uy + along * ny, ratio * uz + along * nz
        return x, y, z, ux, uy, uz

    def bent_by_last_index(self, before: Vector, arithmetic: Arithmetic) -> Vector:
        """Return how the direction beyond the last plane turns with the last medium's index.

        Args:
            before: unit direction before that plane.
            arithmetic: of arrays or of floats.

        """
        nx, ny, nz, _, ratio = self.planes[-1]
        ux, uy, uz = before
        cosine = ux * nx + uy * ny + uz * nz
        sine2 = 1.0 - cosine * cosine
        by_index = -ratio / self.indices[-1]
        along = -(ratio * sine2 / arithmetic.sqrt(1.0 - ratio * ratio * sine2) + cosine)
        return (
            by_index * (ux + along * nx),
            by_index * (uy + along * ny),
            by_index * (uz + along * nz),
        )

    def with_target_index(self, index: float) -> Surfaces:
        """Return the same surfaces with another medium beyond the last one."""
        other = copy.copy(self)
        other.indices = (*self.indices[:-1], index)
        ratio = self.indices[-2] / index
        if self.planes:
            other.planes = (*self.planes[:-1], (*self.planes[-1][:-1], ratio))
        else:
            other.spheres = (*self.spheres[:-1], (*self.spheres[-1][:-1], ratio))
        return other

    @cached_property
    def bases(self) -> FloatArray:
        """Two unit vectors in each plane, (planes, 2, 3)."""
        return np.array([tangents(normal) for normal in self.normals]).reshape(-1, 2, 3)

    @cached_property
    def last_basis(self) -> tuple[tuple[float, float, float], ...]:
        """The two of the last plane, as floats."""
        return tuple(tuple(vector) for vector in self.bases[-1].tolist())

    @cached_property
    def seeds(self) -> Seeds:
        """How each plane and each index answers to each named parameter."""
        if not self.indices:
            return Seeds((), np.zeros((0, 3, 0)), np.zeros((0, 0)), np.zeros((0, 0)))
        surfaces, media = len(self.indices) - 1, len(self.indices)
        names = [TARGET_INDEX]
        vectors, extents = [np.zeros((surfaces, 3))], [np.zeros(surfaces)]
        indices = [np.eye(media)[-1]]
        first = 0
        for label, interface, walls in self._parts:
            last = first + len(walls.extents)
            for name in interface.parameter_names:
                names.append(f'{label}.{name}')
                vectors.append(np.zeros((surfaces, 3)))
                extents.append(np.zeros(surfaces))
                indices.append(np.zeros(media))
                if name in walls.by_name:
                    vectors[-1][first:last], extents[-1][first:last] = walls.by_name[name]
                else:
                    # The medium beyond a port is the interface's first, or the target's.
                    indices[-1][first + int(name.removeprefix('indices.'))] = 1.0
            first = last
        stacked = (np.stack(part, axis=-1) for part in (vectors, extents, indices))
        return Seeds(tuple(names), *stacked)


def _rows(walls: list[Walls], ratios: list[float]) -> tuple[Row, ...]:
    vectors = [row for one in walls for row in one.vectors.tolist()]
    extents = [extent for one in walls for extent in one.extents.tolist()]
    return tuple(
        (x, y, z, extent, ratio)
        for (x, y, z), extent, ratio in zip(vectors, extents, ratios, strict=True)
    )


def _joined(port: tuple[float, ...], wall: tuple[float, ...], name: str) -> tuple[float, ...]:
    if not port:
        return wall
    if port[-1] != wall[0]:
        msg = (
            f'the {name} port ends in a medium of index {port[-1]:g}, but the interface begins in'
            f' one of {wall[0]:g}; both are the medium between them'
        )
        raise OpticsError(msg)
    return port + wall[1:]
