"""What a rig asks of what lies between its cameras and the target; and the flat one of these.

A flat interface is parallel planes, each a jump of the refractive index (Eq. 8).
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.errors import OpticsError

FloatArray = NDArray[np.float64]

#: No medium is thinner than a vacuum.
LEAST_INDEX, GREATEST_INDEX = 1.0, 4.0
#: But an estimate of air's index scatters about 1, and so do the rigs that it goes through.
LEAST_TRIED = 0.9


TARGET_INDEX = 'target_index'
Shape = TypeVar('Shape', bound='Interface')


class Walls(NamedTuple):
    """M refracting surfaces of one shape in one camera's frame, nearest first.

    A plane is normal . x = offset, a sphere |x - centre| = radius.

    Attributes:
        curved: whether they are spheres.
        vectors: (M, 3) unit normals, or centres, m.
        extents: (M,) offsets, or radii, m.
        by_name: how vectors and extents answer to each of the interface's own parameters.

    """

    curved: bool
    vectors: FloatArray
    extents: FloatArray
    by_name: dict[str, tuple[FloatArray, FloatArray]]


class Interface(ABC):
    """Media one behind the other, whatever the shape of what parts them.

    Attributes:
        indices: refractive indices of the media, the camera's first, the target's last.
        thicknesses: of the layers in between, m.

    """

    indices: tuple[float, ...]
    thicknesses: tuple[float, ...]

    @property
    def target_index(self) -> float:
        """The refractive index of the target's medium."""
        return self.indices[-1]

    def with_target_index(self: Shape, index: float) -> Shape:
        """Return the interface with another medium beyond it.

        Raises:
            OpticsError: it is no refractive index of a clear medium.
        """
        other = copy.copy(self)
        other.indices = (*self.indices[:-1], clear_index(index, len(self.indices) - 1))
        return other

    @property
    @abstractmethod
    def axis(self) -> FloatArray:
        """Unit vector (3,) from the camera into the target's medium."""

    @property
    @abstractmethod
    def parameter_names(self) -> tuple[str, ...]:
        """The names of its own parameters: all but the target's index."""

    @property
    @abstractmethod
    def written(self) -> dict[str, str | float | Sequence[float]]:
        """Its values under the names that they have in parameter files."""

    @abstractmethod
    def changed(self, change: Mapping[str, float]) -> Interface:
        """Return the interface after changes of parameters by name, the target's index too.

        Raises:
            OpticsError: such an interface cannot exist.
        """

    @abstractmethod
    def change_since(self, other: Interface) -> dict[str, float]:
        """Return the change of its own parameters that leads here from one of its shape."""

    @abstractmethod
    def walls(self, rotation: FloatArray, translation: FloatArray) -> Walls:
        """Return its surfaces where x = rotation @ x_own + translation."""


class FlatInterface(Interface):
    """One or more parallel planes between the camera's medium and the target's.

    Args:
        normal: (3,) direction from the cameras into the target's medium, in the frame of the rig
            (a shared surface) or of one camera (its own port). Scaled to unit length.
        distance: from that frame's origin to the first plane, along the normal, m.
        indices: refractive indices of the media, the camera's first, the target's last.
        thicknesses: of the layers in between, m; two fewer than there are indices.

    Raises:
        OpticsError: such an interface cannot exist, or lies behind the camera.

    Examples:
        A tank's wall of 6 mm, half a metre ahead:

        >>> FlatInterface((0, 0, 2), 0.5, (1.0, 1.46, 1.333), (0.006,)).parameter_names
        ('normal.0', 'normal.1', 'distance', 'thicknesses.0', 'indices.0', 'indices.1')

    """

    def __init__(
        self,
        normal: ArrayLike,
        distance: float,
        indices: Sequence[float] | FloatArray,
        thicknesses: Sequence[float] | FloatArray = (),
    ) -> None:
        self.normal = _unit(normal)
        self.distance = positive(distance, 'the interface must lie ahead of the camera: distance')
        self.indices = tuple(clear_index(n, i) for i, n in enumerate(np.ravel(indices)))
        self.thicknesses = tuple(
            positive(t, f'layer {i} must have a positive thickness: thicknesses[{i}]')
            for i, t in enumerate(np.ravel(thicknesses))
        )
        if len(self.indices) != len(self.thicknesses) + 2:
            msg = (
                f'{len(self.thicknesses)} layers lie between {len(self.thicknesses) + 2} media, '
                f"but {len(self.indices)} indices are given: one per medium, the camera's first"
            )
            raise OpticsError(msg)

    def __repr__(self) -> str:
        normal = ', '.join(f'{x:g}' for x in self.normal)
        return (
            f'FlatInterface(normal=({normal}), distance={self.distance:g} m, '
            f'indices={self.indices}, thicknesses={self.thicknesses} m)'
        )

    @property
    def axis(self) -> FloatArray:
        """The normal."""
        return self.normal

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """normal.0, normal.1 (rad, along `tangents`), distance, thicknesses.i (m), indices.i."""
        return 'normal.0', 'normal.1', 'distance', *layer_names(self.thicknesses)

    @property
    def written(self) -> dict[str, str | float | Sequence[float]]:
        """Its values under the names that they have in parameter files."""
        values: dict[str, str | float | Sequence[float]] = {
            'normal': self.normal.tolist(),
            'distance': self.distance,
            'indices': self.indices,
        }
        return values | ({'thicknesses': self.thicknesses} if self.thicknesses else {})

    def changed(self, change: Mapping[str, float]) -> FlatInterface:
        """Return the interface after changes of parameters by name.

        Raises:
            OpticsError: such an interface cannot exist.
        """
        other = FlatInterface(
            self.tilted(change.get('normal.0', 0.0), change.get('normal.1', 0.0)),
            self.distance + change.get('distance', 0.0),
            np.maximum(self.indices, LEAST_INDEX),
            [t + change.get(f'thicknesses.{i}', 0.0) for i, t in enumerate(self.thicknesses)],
        )
        other.indices = changed_indices(self.indices, change)
        return other

    def change_since(self, other: Interface) -> dict[str, float]:
        """Return the change of its own parameters that leads here from another flat one."""
        assert isinstance(other, FlatInterface)
        along = max(float(self.normal @ other.normal), 1e-6)
        first, second = (tangents(other.normal) @ self.normal / along).tolist()
        moved = {'normal.0': first, 'normal.1': second, 'distance': self.distance - other.distance}
        return moved | layer_changes(self, other)

    def walls(self, rotation: FloatArray, translation: FloatArray) -> Walls:
        """Return its planes where x = rotation @ x_own + translation (see `Interface`)."""
        normal, count = rotation @ self.normal, len(self.thicknesses) + 1
        depths = np.cumsum([self.distance + float(normal @ translation), *self.thicknesses])
        still = np.zeros((count, 3))
        by_name = {}
        for i, tangent in enumerate(tangents(self.normal) @ rotation.T):
            turned = np.tile(tangent, (count, 1))
            by_name[f'normal.{i}'] = turned, np.full(count, tangent @ translation)
        by_name['distance'] = still, np.ones(count)
        for i in range(count - 1):
            by_name[f'thicknesses.{i}'] = still, (np.arange(count) > i).astype(float)
        return Walls(False, np.tile(normal, (count, 1)), depths, by_name)

    def tilted(self, first: float, second: float) -> FloatArray:
        """Return the normal moved by two angles, rad, along the directions of `tangents`."""
        moved = self.normal + np.array([first, second]) @ tangents(self.normal)
        return moved / np.linalg.norm(moved)


def layer_names(thicknesses: Sequence[float]) -> tuple[str, ...]:
    """Return the names of layers' parameters: thicknesses.i, and indices.i but the target's."""
    layers = range(len(thicknesses))
    return (
        *(f'thicknesses.{i}' for i in layers),
        *(f'indices.{i}' for i in (*layers, len(layers))),
    )


def changed_indices(indices: Sequence[float], change: Mapping[str, float]) -> tuple[float, ...]:
    """Return indices after changes by name; a step may leave one below 1.

    Raises:
        OpticsError: one of them is far from what a clear medium has.
    """
    names = [*(f'indices.{i}' for i in range(len(indices) - 1)), TARGET_INDEX]
    changed = (n + change.get(name, 0.0) for n, name in zip(indices, names, strict=True))
    return tuple(_index(n, i, LEAST_TRIED) for i, n in enumerate(changed))


def layer_changes(new: Interface, old: Interface) -> dict[str, float]:
    """Return the changes of layers' parameters from one interface to another of as many layers."""
    values = ((*one.thicknesses, *one.indices[:-1]) for one in (new, old))
    names = layer_names(new.thicknesses)
    return {name: a - b for name, a, b in zip(names, *values, strict=True)}


def tangents(normal: FloatArray) -> FloatArray:
    """Return two unit vectors that with `normal` make an orthonormal basis, as rows of (2, 3)."""
    aside = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(normal, aside)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _unit(normal: ArrayLike) -> FloatArray:
    vector = np.array(normal, dtype=float)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not np.isfinite(length) or length < 1e-9:
        msg = f"the interface's normal must be a direction of three numbers, not {normal!r}"
        raise OpticsError(msg)
    vector /= length
    vector.flags.writeable = False
    return vector


def positive(value: float, what: str) -> float:
    """Return a length, m, or say that it must be above 0."""
    if not (math.isfinite(value) and value > 0.0):
        msg = f'{what} must be above 0 m, not {value:g}'
        raise OpticsError(msg)
    return float(value)


def clear_index(value: float, place: int) -> float:
    """Return the refractive index of a clear medium, or say that there is none such."""
    return _index(value, place, LEAST_INDEX)


def _index(value: float, place: int, least: float) -> float:
    if not (math.isfinite(value) and least <= value <= GREATEST_INDEX):
        msg = f'indices[{place}] = {value:g} is no refractive index of a clear medium (1 to 4)'
        raise OpticsError(msg)
    return float(value)
