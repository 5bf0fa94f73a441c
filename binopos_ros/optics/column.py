"""Layered water: a column whose index changes with depth, as thin layers, and its mean index.

The mean index of a column is here the index of the homogeneous column of the same height that
displaces a ray by the same amount. For a ray of invariant p = n sin(angle) and layers of
thickness t_i and index n_i it is

    mean^2 = p^2 + (sum_i t_i)^2 / (sum_i t_i / sqrt(n_i^2 - p^2))^2,

which for a ray along the normal is the harmonic mean: the index that apparent depth shows. It
depends on the ray only in second order of the column's contrast, so that one number serves all
rays: at 60 degrees in air it has moved by about the variance of the index over the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import FlatInterface


def mean_index(
    indices: Sequence[float], thicknesses: Sequence[float], invariant: float = 0.0
) -> float:
    """Return the mean refractive index of a column of layers.

    Args:
        indices: of the layers.
        thicknesses: of the layers, m.
        invariant: index times sine of the angle to the normal, the same in every layer; 0 is a ray
            along the normal.

    Raises:
        OpticsError: unequal numbers, an impossible layer, or a ray totally reflected on its way.

    """
    n, t = np.asarray(indices, dtype=float), np.asarray(thicknesses, dtype=float)
    if n.shape != t.shape or n.ndim != 1 or not n.size:
        msg = f'a column needs one thickness per index, not {n.shape} and {t.shape}'
        raise OpticsError(msg)
    if not ((n >= 1.0).all() and (t >= 0.0).all() and 0.0 < t.sum() < math.inf):
        msg = 'a column needs indices of 1 or more and thicknesses that are not negative'
        raise OpticsError(msg)
    if not 0.0 <= invariant < n.min():
        msg = f'a ray of invariant {invariant:g} does not pass a layer of index {n.min():g}'
        raise OpticsError(msg)
    run = (t / np.sqrt(n * n - invariant * invariant)).sum()
    return math.hypot(invariant, t.sum() / run)


def graded_interface(
    normal: ArrayLike,
    distance: float,
    camera_index: float,
    profile: Callable[[float], float],
    depth: float,
    layers: int = 20,
) -> FlatInterface:
    """Return a surface above water whose index changes with depth.

    Below `depth` the water is taken as homogeneous. A ray's place converges with the square of
    the layers' thickness.

    Args:
        normal: see `FlatInterface`.
        distance: see `FlatInterface`, m.
        camera_index: of the cameras' medium.
        profile: refractive index as a function of the depth under the surface, m.
        depth: of the graded part, m.
        layers: into which the graded part is cut, each with the index of its middle.

    Raises:
        OpticsError: the profile or the layers cannot exist.

    """
    if layers < 1 or not depth > 0.0:
        msg = (
            f'graded water needs a depth above 0 m and one layer or more, not {depth:g}, {layers}'
        )
        raise OpticsError(msg)
    step = depth / layers
    middles = [profile((i + 0.5) * step) for i in range(layers)]
    return FlatInterface(
        normal, distance, [camera_index, *middles, profile(depth)], [step] * layers
    )
