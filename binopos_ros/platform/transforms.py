"""Transforms between two frames: how they are made, joined, turned round and interpolated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from binopos_ros.platform.errors import PlatformError
from binopos_ros.platform.quaternions import (
    IDENTITY,
    Quaternion,
    Vector,
    conjugate,
    product,
    slerp,
    turned,
)

#: What rounding to a few digits leaves of a quaternion's length; more is no rotation.
LENGTH_TOLERANCE = 0.01


class Transform(NamedTuple):
    """Where a frame `child` is in a frame `parent`: x_parent = rotation x_child + translation."""

    translation: Vector
    rotation: Quaternion


SAME = Transform((0.0, 0.0, 0.0), IDENTITY)


def transform_of(translation: Sequence[float], rotation: Sequence[float]) -> Transform:
    """A transform from the numbers of a message or a parameter.

    Args:
        translation: x, y, z in m.
        rotation: x, y, z, w.

    Raises:
        PlatformError: numbers that are not finite, or a quaternion whose length is not 1.
    """
    x, y, z = (float(value) for value in translation)
    qx, qy, qz, qw = (float(value) for value in rotation)
    length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not (math.isfinite(x + y + z) and math.isfinite(length)):
        msg = 'numbers that are not finite'
        raise PlatformError(msg)
    if abs(length - 1) > LENGTH_TOLERANCE:
        msg = f'a quaternion of length {length:.3g}, which must be 1'
        raise PlatformError(msg)
    return Transform((x, y, z), (qx / length, qy / length, qz / length, qw / length))


def joined(a_from_b: Transform, b_from_c: Transform) -> Transform:
    """The transform a_from_c."""
    x, y, z = turned(a_from_b.rotation, b_from_c.translation)
    u, v, w = a_from_b.translation
    return Transform((x + u, y + v, z + w), product(a_from_b.rotation, b_from_c.rotation))


def inverse(a_from_b: Transform) -> Transform:
    """The transform b_from_a."""
    back = conjugate(a_from_b.rotation)
    x, y, z = turned(back, a_from_b.translation)
    return Transform((-x, -y, -z), back)


def between(first: Transform, second: Transform, weight: float) -> Transform:
    """On the way from one to another: straight for the place, slerp for the rotation."""
    (x, y, z), (u, v, w) = first.translation, second.translation
    place = (x + weight * (u - x), y + weight * (v - y), z + weight * (w - z))
    return Transform(place, slerp(first.rotation, second.rotation, weight))
