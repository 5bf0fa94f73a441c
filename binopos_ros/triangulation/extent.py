"""How large a target looks where it is: whether what both cameras saw can be it.

Two patches of which one is no target meet somewhere too; there a target of known diameter would
look larger or smaller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from binopos_ros.sides import SIDES

Array = NDArray[np.float64]

AXES = np.vstack([np.eye(3), -np.eye(3)])

MOST_OFF = 1.5
"""Largest factor between the two: blur, a hidden part and a diameter that is given in round
numbers make up less."""


def other_size(
    project: Callable[[Array], Sequence[Array]],
    position: Array,
    diameter: float,
    seen: Sequence[float],
) -> str:
    """Why what was seen is not a target of that size, or '' where it may be.

    Args:
        project: points (N, 3) m to their images (N, 2) px in each camera.
        position: of the target (3,), m.
        diameter: of the target, m.
        seen: its diameter in each camera, px; 0 where a detector tells none.
    """
    images = project(position + diameter / 2 * AXES)
    for side, image, across in zip(SIDES, images, seen, strict=True):
        expected = _longest(image[:3] - image[3:])
        if across > 0 and expected > 0 and not 1 / MOST_OFF <= across / expected <= MOST_OFF:
            return (
                f'{side}: {across:.1f} px across, where a target of {diameter:g} m would look '
                f'{expected:.1f} px'
            )
    return ''


def _longest(axes: Array) -> float:
    """The longest image, px, of a ball's diameters, by those of three (3, 2) at right angles.

    It is the matrix's largest singular value; a diameter that is not seen whole counts nothing.
    """
    uu = uv = vv = 0.0
    for u, v in axes.tolist():
        if math.isfinite(u + v):
            uu, uv, vv = uu + u * u, uv + u * v, vv + v * v
    return math.sqrt((uu + vv) / 2 + math.hypot((uu - vv) / 2, uv))
