"""The refracting planes in front of one camera, in its own frame and in the order of the light.

A camera may look through its own port, through a shared surface, or through both. Here they
become one list of planes and media, together with how each plane and index answers to the named
parameters of the interfaces.
"""

from __future__ import annotations

import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.arithmetic import ARRAYS, Arithmetic, Component
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import FlatInterface, tangents

FloatArray = NDArray[np.float64]

PARALLEL = 1e-12  # rad; below this two normals are one
CAMERA_SIDE = 'on the camera side of the last surface'
TOTAL_REFLECTION = 'total reflection'
MISSES_SURFACE = 'the ray does not reach the surfaces in their order'


class Seeds(NamedTuple):
    """Derivatives of planes and indices with respect to K named parameters."""

    names: tuple[str, ...]
    normals: FloatArray  # (planes, 3, K)
    offsets: FloatArray  # (planes, K), m
    indices: FloatArray  # (planes + 1, K)


class Surfaces:
    """Planes normal . x = offset of one camera's frame, nearest first, and the media they part.

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
        port: FlatInterface | None,
        interface: FlatInterface | None,
        rotation: FloatArray,
        translation: FloatArray,
        name: str,
    ) -> None:
        self._port, self._interface, self._name = port, interface, name
        self._rotation, self._translation = rotation, translation
        normals: list[FloatArray] = []
        offsets: list[float] = []
        self.indices: tuple[float, ...] = ()
        if port is not None:
            normals += [port.normal] * (len(port.thicknesses) + 1)
            offsets += np.cumsum([port.distance, *port.thicknesses]).tolist()
            self.indices = port.indices
        if interface is not None:
            normal = rotation @ interface.normal
            distance = interface.distance + float(normal @ translation)
            if distance <= 0.0:
                msg = (
                    f"the {name} camera lies {-distance:g} m beyond the interface's first surface"
                )
                raise OpticsError(msg)
            normals += [normal] * (len(interface.thicknesses) + 1)
            offsets += np.cumsum([distance, *interface.thicknesses]).tolist()
            self.indices = _joined(self.indices, interface.indices, name)
        self.normals = np.array(normals).reshape(-1, 3)
        self.offsets = np.array(offsets)
        self.parallel = self._are_parallel()
        if self.parallel and (np.diff(self.offsets) <= 0.0).any():
            msg = f"the {name} camera's port reaches beyond the interface; mend their distances"
            raise OpticsError(msg)
        self.planes = tuple(
            (*normal, offset, first / second)
            for normal, offset, first, second in zip(
                self.normals.tolist(),
                self.offsets.tolist(),
                self.indices[:-1],
                self.indices[1:],
                strict=True,
            )
        )

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

    def with_target_index(self, index: float) -> Surfaces:
        """Return the same planes with another medium beyond the last one."""
        other = copy.copy(self)
        other.indices = (*self.indices[:-1], index)
        other.planes = (*self.planes[:-1], (*self.planes[-1][:-1], self.indices[-2] / index))
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
        names: list[str] = []
        planes, media = len(self.normals), len(self.indices)
        columns: list[tuple[FloatArray, FloatArray, FloatArray]] = []

        def add(name: str) -> tuple[FloatArray, FloatArray, FloatArray]:
            names.append(name)
            columns.append((np.zeros((planes, 3)), np.zeros(planes), np.zeros(media)))
            return columns[-1]

        add('target_index')[2][-1] = 1.0
        first = 0
        for surface, label, rotation, translation in (
            (self._port, f'{self._name}_port', np.eye(3), np.zeros(3)),
            (self._interface, 'interface', self._rotation, self._translation),
        ):
            if surface is None:
                continue
            last = first + len(surface.thicknesses) + 1
            for i, tangent in enumerate(tangents(surface.normal) @ rotation.T):
                normals, offsets, _ = add(f'{label}.normal.{i}')
                normals[first:last] = tangent
                offsets[first:last] = tangent @ translation
            add(f'{label}.distance')[1][first:last] = 1.0
            for i in range(len(surface.thicknesses)):
                add(f'{label}.thicknesses.{i}')[1][first + 1 + i : last] = 1.0
            # The medium beyond a port is the interface's first, or the target's.
            for i in range(len(surface.indices) - 1):
                add(f'{label}.indices.{i}')[2][first + i] = 1.0
            first = last
        normals, offsets, indices = (
            np.stack(part, axis=-1) for part in zip(*columns, strict=True)
        )
        return Seeds(tuple(names), normals, offsets, indices)


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
