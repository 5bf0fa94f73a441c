"""A dome port: two concentric spheres around one camera, and the media that they part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import (
    LEAST_INDEX,
    Interface,
    Walls,
    changed_indices,
    clear_index,
    layer_changes,
    layer_names,
    positive,
)

FloatArray = NDArray[np.float64]

#: Media: inside the dome, its wall, the target's.
MEDIA = 3


class DomePort(Interface):
    """A dome around one camera, which stands inside it.

    Where the dome's centre is the camera's, rays cross it unbent. It has no axis of its own: how
    far round the dome reaches is not asked.

    Args:
        centre: (3,) of the spheres, in the camera's frame, m.
        radius: of the inner sphere, m.
        thickness: of the wall, m.
        indices: refractive indices inside the dome, of its wall and of the medium beyond.

    Raises:
        OpticsError: such a dome cannot exist, or does not hold the camera.

    Examples:
        >>> DomePort((0, 0, 0.002), radius=0.05, thickness=0.005, indices=(1.0, 1.49, 1.333))
        DomePort(centre=(0, 0, 0.002) m, radius=0.05 m, thickness=0.005 m, \
indices=(1.0, 1.49, 1.333))

    """

    def __init__(
        self,
        centre: ArrayLike,
        radius: float,
        thickness: float,
        indices: Sequence[float] | FloatArray,
    ) -> None:
        self.centre = _centre(centre)
        self.radius = positive(radius, "a dome's inner radius")
        self.thickness = positive(thickness, "a dome's thickness")
        self.thicknesses = (self.thickness,)
        self.indices = tuple(clear_index(n, i) for i, n in enumerate(np.ravel(indices)))
        if len(self.indices) != MEDIA:
            msg = (
                f'a dome parts {MEDIA} media, but {len(self.indices)} indices are given: one'
                ' inside it, one of its wall, one beyond'
            )
            raise OpticsError(msg)
        off = float(np.linalg.norm(self.centre))
        if off >= self.radius:
            msg = (
                f"the camera must stand inside its dome: the dome's centre is {off:g} m from it,"
                f' the inner radius {self.radius:g} m'
            )
            raise OpticsError(msg)

    def __repr__(self) -> str:
        centre = ', '.join(f'{x:g}' for x in self.centre)
        return (
            f'DomePort(centre=({centre}) m, radius={self.radius:g} m, '
            f'thickness={self.thickness:g} m, indices={self.indices})'
        )

    @property
    def axis(self) -> FloatArray:
        """The camera's optical axis."""
        return np.array([0.0, 0.0, 1.0])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """centre.0 to centre.2, radius, thicknesses.0 (m), indices.0 and indices.1."""
        return 'centre.0', 'centre.1', 'centre.2', 'radius', *layer_names(self.thicknesses)

    @property
    def written(self) -> dict[str, str | float | Sequence[float]]:
        """Its values under the names that they have in parameter files."""
        return {
            'shape': 'dome',
            'centre': self.centre.tolist(),
            'radius': self.radius,
            'thicknesses': self.thicknesses,
            'indices': self.indices,
        }

    def changed(self, change: Mapping[str, float]) -> DomePort:
        """Return the dome after changes of parameters by name.

        Raises:
            OpticsError: such a dome cannot exist.
        """
        other = DomePort(
            self.centre + [change.get(f'centre.{i}', 0.0) for i in range(3)],
            self.radius + change.get('radius', 0.0),
            self.thickness + change.get('thicknesses.0', 0.0),
            np.maximum(self.indices, LEAST_INDEX),
        )
        other.indices = changed_indices(self.indices, change)
        return other

    def change_since(self, other: Interface) -> dict[str, float]:
        """Return the change of its own parameters that leads here from another dome."""
        assert isinstance(other, DomePort)
        moved = {f'centre.{i}': float(d) for i, d in enumerate(self.centre - other.centre)}
        return moved | {'radius': self.radius - other.radius} | layer_changes(self, other)

    def walls(self, rotation: FloatArray, translation: FloatArray) -> Walls:
        """Return its spheres where x = rotation @ x_own + translation (see `Interface`)."""
        still, none = np.zeros((2, 3)), np.zeros(2)
        by_name = {f'centre.{i}': (np.tile(rotation[:, i], (2, 1)), none) for i in range(3)}
        by_name |= {'radius': (still, np.ones(2)), 'thicknesses.0': (still, np.array([0.0, 1.0]))}
        centre = rotation @ self.centre + translation
        radii = np.array([self.radius, self.radius + self.thickness])
        return Walls(True, np.tile(centre, (2, 1)), radii, by_name)


def _centre(centre: ArrayLike) -> FloatArray:
    vector = np.array(centre, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        msg = f"the dome's centre must be three numbers, m, in the camera's frame, not {centre!r}"
        raise OpticsError(msg)
    vector.flags.writeable = False
    return vector
