"""Unit quaternions (x, y, z, w), as ROS writes them, and the rotations that they stand for.

Plain floats: a handful of products is several times as fast as a small array.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
#: Below this angle, rad, sin x / x is 1 to the last digit, and slerp is a straight line.
_SMALL = 1e-8


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """The rotation `second` followed by `first`."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(rotation: Quaternion) -> Quaternion:
    """The inverse rotation."""
    x, y, z, w = rotation
    return -x, -y, -z, w


def turned(rotation: Quaternion, vector: Vector) -> Vector:
    """A vector after the rotation."""
    x, y, z, w = rotation
    a, b, c = vector
    tx, ty, tz = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return (
        a + w * tx + y * tz - z * ty,
        b + w * ty + z * tx - x * tz,
        c + w * tz + x * ty - y * tx,
    )


def matrix_of(rotation: Quaternion) -> Array:
    """(3, 3) rotation matrix."""
    x, y, z, w = rotation
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(matrix: ArrayLike) -> Quaternion:
    """The quaternion of a rotation matrix (3, 3), with w >= 0.

    By the largest of its components, which no rounding reaches.
    """
    r = np.asarray(matrix, dtype=float)
    squares = (
        1 + r[0, 0] - r[1, 1] - r[2, 2],
        1 - r[0, 0] + r[1, 1] - r[2, 2],
        1 - r[0, 0] - r[1, 1] + r[2, 2],
        1 + r[0, 0] + r[1, 1] + r[2, 2],
    )
    products = (
        (squares[0], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]),
        (r[0, 1] + r[1, 0], squares[1], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]),
        (r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[2], r[1, 0] - r[0, 1]),
        (r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], squares[3]),
    )
    largest = max(range(4), key=squares.__getitem__)
    scale = 2 * math.sqrt(squares[largest])
    if products[largest][3] < 0:
        scale = -scale
    x, y, z, w = (float(value / scale) for value in products[largest])
    return x, y, z, w


def rotation_vector(rotation: Quaternion) -> Vector:
    """Axis times angle, rad, of the shorter way round."""
    x, y, z, w = rotation
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < _SMALL else 2 * math.atan2(sine, w) / sine
    return x * scale, y * scale, z * scale


def of_rotation_vector(vector: ArrayLike) -> Quaternion:
    """The rotation by the length of a vector (3,), rad, about its direction."""
    x, y, z = (float(value) for value in np.asarray(vector, dtype=float))
    angle = math.sqrt(x * x + y * y + z * z)
    scale = 0.5 if angle < _SMALL else math.sin(angle / 2) / angle
    return x * scale, y * scale, z * scale, math.cos(angle / 2)


def slerp(first: Quaternion, second: Quaternion, weight: float) -> Quaternion:
    """The way from one rotation to another at constant rate: Shoemake, SIGGRAPH 1985.

    Args:
        first, second: where it begins and ends; the shorter way round is taken.
        weight: 0 gives `first`, 1 `second`.
    """
    x, y, z = rotation_vector(product(second, conjugate(first)))
    step = of_rotation_vector((weight * x, weight * y, weight * z))
    return product(step, first)
