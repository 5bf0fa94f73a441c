"""Axes along which a measurement errs independently: two across the line of sight, one along it.

The line of sight is the direction of least accuracy of the measurement's covariance.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.scalars import components

Array = NDArray[np.float64]

#: The axes follow the line of sight once its direction is off by half a degree: tangent.
_TURNED = math.tan(math.radians(0.5))


def first_axes(covariance: Array) -> Array:
    """Return the axes (..., 3, 3), rows, of a covariance (..., 3, 3); the last has the most."""
    return np.linalg.eigh(covariance)[1].swapaxes(-1, -2)


def along(axes: Array, covariance: Array) -> Array:
    """Return a covariance (..., 3, 3) in the axes (..., 3, 3)."""
    return axes @ covariance @ axes.swapaxes(-1, -2)


def following(axes: Array, inside: Array) -> Array | None:
    """Return axes (..., 3, 3) that follow the line of sight; None where none need turn.

    `inside` (..., 3, 3) is the measurement's covariance along `axes`.
    """
    first, second, most = components(inside[..., 2, :])
    tilted = np.logical_or(abs(first) > _TURNED * most, abs(second) > _TURNED * most)
    if not tilted.any():
        return None
    # One step of the power method from the last axis; the others are carried along.
    sight = (axes.swapaxes(-1, -2) @ inside[..., 2, :, None])[..., 0]
    sight = sight / np.linalg.norm(sight, axis=-1, keepdims=True)
    across = axes[..., 0, :]
    across = across - (across * sight).sum(axis=-1, keepdims=True) * sight
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    turned = np.stack([across, np.cross(sight, across), sight], axis=-2)
    return np.where(np.asarray(tilted)[..., None, None], turned, axes)
