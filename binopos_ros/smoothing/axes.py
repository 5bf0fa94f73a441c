"""Axes along which a measurement errs independently: two across the line of sight, one along it.

The line of sight is the direction of least accuracy of the measurement's covariance.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.scalars import anywhere, applied, components, product

Array = NDArray[np.float64]

#: The axes follow the line of sight once its direction is off by half a degree: tangent.
_TURNED = math.tan(math.radians(0.5))
# Of each axis with itself, and of the two across with the line of sight.
_FIRST, _SECOND = np.array([0, 1, 2, 0, 1]), np.array([0, 1, 2, 2, 2])


class Axes(NamedTuple):
    """The axes, and what tells of covariances along them.

    Attributes
    ----------
    rows : (..., 3, 3) array
        The axes; the last is the line of sight.
    products : (..., 5, 9) array
        Outer products of each axis with itself, and of the others with the last.
    both : (..., 6, 6) array
        The axes twice, for positions and velocities.

    """

    rows: Array
    products: Array
    both: Array

    @classmethod
    def of(cls, rows: Array) -> Axes:
        """Return the axes in those rows (..., 3, 3)."""
        products = rows[..., _FIRST, :, None] * rows[..., _SECOND, None, :]
        both = np.zeros((*rows.shape[:-2], 6, 6))
        both[..., :3, :3] = both[..., 3:, 3:] = rows
        return cls(rows, products.reshape(*rows.shape[:-2], 5, 9), both)


def first_axes(covariance: Array) -> Axes:
    """Return the axes of a covariance (..., 3, 3); the last has the most."""
    return Axes.of(np.linalg.eigh(covariance)[1].swapaxes(-1, -2))


def along(axes: Axes, covariance: Array) -> Array:
    """Return parts of a covariance (..., parts, 3, 3) along the axes: (..., parts, 5).

    These are the variances, and the covariances of the first and the second with the last.
    """
    flat = covariance.reshape(*covariance.shape[:-2], 9)
    return product(flat, axes.products.swapaxes(-1, -2))


def following(axes: Axes, sight: Array) -> Axes | None:
    """Return axes that follow the line of sight; None where none need turn.

    `sight` (..., 3) are the variance of a measurement along the last axis, and the covariances of
    the first and the second with it.
    """
    most, first, second = components(sight)
    tilted = (abs(first) > _TURNED * most) | (abs(second) > _TURNED * most)
    if not anywhere(tilted):
        return None
    # One step of the power method from the last axis; the others are carried along.
    rows = axes.rows
    last = applied(rows.swapaxes(-1, -2), np.roll(sight, -1, axis=-1))
    last = last / np.linalg.norm(last, axis=-1, keepdims=True)
    across = rows[..., 0, :]
    across = across - (across * last).sum(axis=-1, keepdims=True) * last
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    turned = np.stack([across, np.cross(last, across), last], axis=-2)
    return Axes.of(np.where(np.asarray(tilted)[..., None, None], turned, rows))
