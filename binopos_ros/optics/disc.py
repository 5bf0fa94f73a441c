"""From the centre of a disc's outline to the image of the disc's centre.

They differ: what is nearer is seen larger, and refraction bends the outline out of an ellipse.
At a tilt of 60 degrees and 40 px across the difference is some tenths of a pixel.

How large it is depends on where the disc is and how it lies, which is known only when both images
have been brought together. So this is applied where positions are made: take the offsets where
the rays through the outlines' centres all but meet, and triangulate what is left without them.
That place is wrong by less than a thousandth of the distance, so its offsets are right to a
thousandth of themselves.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.errors import OpticsError

Array = NDArray[np.float64]

Project = Callable[[Array], Sequence[Array]]
"""Projects points (N, 3) m to pixels (N, 2) in each camera, as `StereoRig.project` does."""

RIM_POINTS = 32

CURVE_POINTS = 8
"""Points of a rim whose image is taken for a sum of waves: none of a quadratic map is left out."""


class Outline(NamedTuple):
    """How a round target shows in an image.

    Attributes:
        offset: the outline's centre less the image of the target's centre, (2,) px.
        across: the outline's longest diameter, px.
    """

    offset: Array
    across: float


def disc_outlines(
    project: Project, position: Array, normal: Array, diameter: float
) -> list[Outline]:
    """Give, for each camera, the outline of a disc.

    position (3,) m is where the rays of the outlines' centres meet, normal (3,) the disc's,
    diameter in m. Raises OpticsError where the disc is not seen whole from there.
    """
    position = np.asarray(position, float)
    rim = position + diameter * unit_circle(tuple(np.asarray(normal, float).tolist()))
    found = []
    for image in project(np.concatenate([rim, position[None]])):
        if not math.isfinite(image.sum()):
            msg = f'the disc at {np.round(position, 3).tolist()} m is not seen whole'
            raise OpticsError(msg)
        curve = image[:-1] - image[-1]
        found.append(Outline(centroid_within(curve), longest_diameter(curve)))
    return found


def longest_diameter(curve: Array) -> float:
    """The longest diameter of an ellipse, by points at equal steps of its circle (N, 2).

    What makes a curve differ from an ellipse is of other frequencies, and leaves this unmoved.
    """
    (a, b), (c, d) = (_first_wave(len(curve)) @ curve).tolist()
    # The largest singular value of the map that makes the ellipse of a circle.
    uu, uv, vv = a * a + c * c, a * b + c * d, b * b + d * d
    return math.sqrt((uu + vv) / 2 + math.hypot((uu - vv) / 2, uv))


@functools.lru_cache(maxsize=4)
def _first_wave(count: int) -> Array:
    """Matrix (2, N) that gives, of values at equal steps, twice their first cosine and sine."""
    angles = np.arange(count) * (2 * math.pi / count)
    return np.array([np.cos(angles), np.sin(angles)]) * (4 / count)


def unit_vector(vector: Array) -> Array:
    """The direction of a disc's normal; OpticsError where it is no three numbers, or all 0."""
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length < 1e-9:
        msg = f'normal of the disc is {vector.tolist()}: give three numbers, not all 0'
        raise OpticsError(msg)
    unit: Array = vector / length
    return unit


@functools.lru_cache(maxsize=64)
def unit_rim(normal: tuple[float, ...]) -> Array:
    """A polygon of the area of a disc of diameter 1 about the origin, (N + 1, 3) and closed."""
    step = 2 * math.pi / RIM_POINTS
    angle, radius = np.arange(RIM_POINTS + 1) * step, math.sqrt(step / math.sin(step)) / 2
    rim: Array = radius * _around(normal, angle)
    rim.flags.writeable = False
    return rim


@functools.lru_cache(maxsize=64)
def unit_circle(normal: tuple[float, ...]) -> Array:
    """CURVE_POINTS equal steps along the rim of a disc of diameter 1 about the origin, (N, 3)."""
    circle: Array = _around(normal, np.arange(CURVE_POINTS) * (2 * math.pi / CURVE_POINTS)) / 2
    circle.flags.writeable = False
    return circle


def _around(normal: tuple[float, ...], angles: NDArray[np.floating[Any]]) -> Array:
    """Unit vectors across a normal, (N, 3), at angles about it."""
    x, y, z = unit_vector(np.array(normal)).tolist()
    # Two directions across the normal, none of them short wherever it points (Duff et al. 2017).
    sign = math.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    first, second = (1 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)
    around: Array = np.outer(np.cos(angles), first) + np.outer(np.sin(angles), second)
    return around


def _differentiation(count: int) -> Array:
    """Matrix (N, N) that differentiates a sum of waves by its values at equal steps (N even).

    Trefethen, Spectral Methods in MATLAB (2000), Eq. 3.10.
    """
    steps = np.arange(count)[:, None] - np.arange(count)
    with np.errstate(divide='ignore'):
        entries = 0.5 * (-1.0) ** steps / np.tan(math.pi * steps / count)
    return np.where(steps == 0, 0.0, entries)


_BY_STEP = _differentiation(CURVE_POINTS)


def centroid_within(curve: Array) -> Array:
    """Centroid (2,) of the area within a smooth closed curve, by CURVE_POINTS of it (N, 2).

    The curve is taken for a sum of waves, of which Green's integrals are sums over the points.
    """
    (x, y), (dx, dy) = curve.T, (_BY_STEP @ curve).T
    twice_area = x @ dy - y @ dx
    return np.array([(x * x) @ dy, -(y * y) @ dx]) / twice_area


def _crosses(outline: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Of a closed polygon (N + 1, 2) from its first point on: both ends of each side, and z."""
    x, y = (outline - outline[0]).T
    return x[:-1], x[1:], y[:-1], y[1:], x[:-1] * y[1:] - x[1:] * y[:-1]


def centroid(outline: Array) -> Array:
    """Centroid of the area within a closed polygon (N + 1, 2)."""
    x, nx, y, ny, cross = _crosses(outline)
    centroid: Array = outline[0] + np.array([(x + nx) @ cross, (y + ny) @ cross]) / (
        3 * cross.sum()
    )
    return centroid


def enclosed_moments(outline: Array) -> Array:
    """Second central moments (2, 2) of the area within a closed polygon (N + 1, 2), by Green."""
    x, nx, y, ny, cross = _crosses(outline)
    area = cross.sum() / 2
    u, v = ((x + nx) @ cross) / (6 * area), ((y + ny) @ cross) / (6 * area)
    uu = ((x * x + x * nx + nx * nx) @ cross) / (12 * area) - u * u
    vv = ((y * y + y * ny + ny * ny) @ cross) / (12 * area) - v * v
    uv = ((x * ny + 2 * x * y + 2 * nx * ny + nx * y) @ cross) / (24 * area) - u * v
    return np.array([[uu, uv], [uv, vv]])
