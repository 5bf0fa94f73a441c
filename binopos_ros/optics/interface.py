"""A flat interface between media: parallel planes, each a jump of the refractive index (Eq. 8)."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.errors import OpticsError

FloatArray = NDArray[np.float64]


class FlatInterface:
    """One or more parallel planes between the camera's medium and the target's.

    Args:
        normal: (3,) direction from the cameras into the target's medium, in the frame of the rig
            (a shared surface) or of one camera (its own port). Scaled to unit length.
        distance: from that frame's origin to the first plane, along the normal, m.
        indices: refractive indices of the media, the camera's first, the target's last.
        thicknesses: of the layers in between, m; two fewer than there are indices.

    Raises:
        OpticsError: such an interface cannot exist, or lies behind the camera.

    """

    def __init__(
        self,
        normal: ArrayLike,
        distance: float,
        indices: Sequence[float] | FloatArray,
        thicknesses: Sequence[float] | FloatArray = (),
    ) -> None:
        self.normal = _unit(normal)
        self.distance = _positive(distance, 'the interface must lie ahead of the camera: distance')
        self.indices = tuple(_index(n, i) for i, n in enumerate(np.ravel(indices)))
        self.thicknesses = tuple(
            _positive(t, f'layer {i} must have a positive thickness: thicknesses[{i}]')
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
    def target_index(self) -> float:
        """The refractive index of the target's medium."""
        return self.indices[-1]

    def with_target_index(self, index: float) -> FlatInterface:
        """Return the interface with another medium beyond it.

        Raises:
            OpticsError: it is no refractive index of a clear medium.
        """
        other = copy.copy(self)
        other.indices = (*self.indices[:-1], _index(index, len(self.indices) - 1))
        return other

    def tilted(self, first: float, second: float) -> FloatArray:
        """Return the normal moved by two angles, rad, along the directions of `tangents`."""
        moved = self.normal + np.array([first, second]) @ tangents(self.normal)
        return moved / np.linalg.norm(moved)


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


def _positive(value: float, what: str) -> float:
    if not (math.isfinite(value) and value > 0.0):
        msg = f'{what} must be above 0 m, not {value:g}'
        raise OpticsError(msg)
    return float(value)


def _index(value: float, place: int) -> float:
    if not (math.isfinite(value) and 1.0 <= value <= 4.0):
        msg = f'indices[{place}] = {value:g} is no refractive index of a clear medium (1 to 4)'
        raise OpticsError(msg)
    return float(value)
