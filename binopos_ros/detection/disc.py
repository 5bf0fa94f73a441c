"""From the centre of a disc's outline to the image of the disc's centre.

They differ: what is nearer is seen larger, and refraction bends the outline out of an ellipse.
At a tilt of 60 degrees and 40 px across the difference is some tenths of a pixel.

How large it is depends on where the disc is and how it lies, which is known only when both images
have been brought together. So this is applied where positions are made: triangulate the outlines'
centres, take the offsets at that position, and triangulate again. The first position is wrong by
less than a thousandth of the distance, so its offsets are right to a thousandth of themselves.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from .errors import DetectionError
from .target import Array, Ellipse

Project = Callable[[Array], Sequence[Array]]
"""Projects points (N, 3) m to pixels (N, 2) in each camera, as `StereoRig.project` does."""

RIM_POINTS = 32
TILTS = np.radians([0.5, 15, 30, 45, 60, 75])
AZIMUTHS = np.radians(np.arange(0, 360, 30))
REFINEMENTS = 8


@dataclass(frozen=True)
class DiscOptions:
    """The target as a disc. Raises DetectionError where a value is of no use."""

    diameter: float = field(
        default=0.0,
        metadata={
            'description': 'Diameter of the disc; above 0, the image of its centre is used '
            "instead of the outline's centre",
            'unit': 'm',
            'range': (0.0, 10.0),
        },
    )
    normal: tuple[float, ...] = field(
        default=(),
        metadata={
            'description': 'Normal of the disc in the rig frame; left out: that of the interface, '
            'as for a disc on the floor under a water surface',
        },
    )

    def __post_init__(self) -> None:
        if not 0 <= self.diameter <= 10:
            msg = f'target.diameter is {self.diameter}: give metres, 0 to 10'
            raise DetectionError(msg)
        if self.normal:
            _unit(np.array(self.normal, float))


def to_disc_centres(
    project: Project,
    outline_centres: Sequence[Array],
    position: Array,
    normal: Array,
    diameter: float,
) -> list[Array]:
    """Shift outlines' centres, (2,) px for each camera, to the images of the disc's centre.

    position (3,) m is where the outlines' centres meet, normal (3,) the disc's, diameter in m.
    Raises DetectionError where the disc is not seen whole from there.
    """
    offsets = outline_offsets(project, position, normal, diameter)
    return [
        np.asarray(centre, float) - offset
        for centre, offset in zip(outline_centres, offsets, strict=True)
    ]


def outline_offsets(
    project: Project, position: Array, normal: Array, diameter: float
) -> list[Array]:
    """Give, for each camera, the outline's centre less the image of the disc's centre, (2,) px."""
    position = np.asarray(position, float)
    rim = position + diameter * _unit_rim(tuple(np.asarray(normal, float).tolist()))
    offsets = []
    for image in project(np.concatenate([rim, position[None]])):
        if not math.isfinite(image.sum()):
            msg = f'the disc at {np.round(position, 3).tolist()} m is not seen whole'
            raise DetectionError(msg)
        offsets.append(_centroid(image[:-1]) - image[-1])
    return offsets


def estimate_normal(
    project: Project, outlines: Sequence[Ellipse], position: Array, diameter: float
) -> Array:
    """Give the disc's unit normal (3,), towards the cameras, from its outlines.

    The outlines' second moments are compared with those of discs of all orientations. One camera
    leaves two orientations that look nearly alike; two cameras tell them apart, the better the
    wider the baseline and the larger the tilt.
    """
    position = np.asarray(position, float)
    forward = _unit(position)
    across = np.linalg.svd(forward[None])[2][1:]

    def normal_of(slant: Array) -> Array:
        return _unit(slant @ across - forward)

    def misfit(slant: Array) -> Array:
        rests = []
        rim = _unit_rim(tuple(normal_of(slant).tolist()))
        images = project(position + diameter * rim)
        for image, outline in zip(images, outlines, strict=True):
            expected = _enclosed(image).moments
            rest = (expected - outline.moments) / np.trace(outline.moments)
            rests += [rest[0, 0], rest[1, 1], rest[0, 1] * np.sqrt(2)]
        return np.array(rests)

    starts = [
        np.tan(tilt) * np.array([np.cos(azimuth), np.sin(azimuth)])
        for tilt in TILTS
        for azimuth in AZIMUTHS
    ]
    costs = [float(np.sum(misfit(start) ** 2)) for start in starts]
    if not np.isfinite(costs).any():
        msg = f'the disc at {np.round(position, 3).tolist()} m is not seen whole'
        raise DetectionError(msg)
    best = None
    for k in np.argsort(costs)[:4]:
        slant = _refined(misfit, starts[k])
        cost = float(np.sum(misfit(slant) ** 2))
        if best is None or cost < best[0]:
            best = cost, slant
    assert best is not None
    return normal_of(best[1])


def _refined(misfit: Callable[[Array], Array], slant: Array) -> Array:
    step = 1e-5
    for _ in range(REFINEMENTS):
        rest = misfit(slant)
        jacobian = np.column_stack(
            [(misfit(slant + step * each) - rest) / step for each in np.eye(2)]
        )
        normal = jacobian.T @ jacobian + 1e-6 * np.eye(2)
        change = np.linalg.solve(normal, -jacobian.T @ rest)
        slant = slant + np.clip(change, -0.5, 0.5)
    return slant


def _unit(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    if vector.shape != (3,) or not np.isfinite(length) or length < 1e-9:
        msg = f'normal of the disc is {vector.tolist()}: give three numbers, not all 0'
        raise DetectionError(msg)
    unit: Array = vector / length
    return unit


@functools.lru_cache(maxsize=64)
def _unit_rim(normal: tuple[float, ...]) -> Array:
    """A polygon of the area of a disc of diameter 1 about the origin, (N + 1, 3) and closed."""
    x, y, z = _unit(np.array(normal)).tolist()
    # Two directions across the normal, none of them short wherever it points (Duff et al. 2017).
    sign = math.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    first, second = (1 + sign * x * x * a, sign * b, -sign * x), (b, sign + y * y * a, -y)
    step = 2 * math.pi / RIM_POINTS
    angle, radius = np.arange(RIM_POINTS + 1) * step, math.sqrt(step / math.sin(step)) / 2
    rim: Array = radius * (np.outer(np.cos(angle), first) + np.outer(np.sin(angle), second))
    rim.flags.writeable = False
    return rim


def _crosses(outline: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Of a closed polygon (N + 1, 2) from its first point on: both ends of each side, and z."""
    x, y = (outline - outline[0]).T
    return x[:-1], x[1:], y[:-1], y[1:], x[:-1] * y[1:] - x[1:] * y[:-1]


def _centroid(outline: Array) -> Array:
    """Centroid of the area within a closed polygon (N + 1, 2)."""
    x, nx, y, ny, cross = _crosses(outline)
    centroid: Array = outline[0] + np.array([(x + nx) @ cross, (y + ny) @ cross]) / (
        3 * cross.sum()
    )
    return centroid


def _enclosed(outline: Array) -> Ellipse:
    """Centroid and second central moments of the area within a closed polygon, by Green."""
    x, nx, y, ny, cross = _crosses(outline)
    area = cross.sum() / 2
    u, v = ((x + nx) @ cross) / (6 * area), ((y + ny) @ cross) / (6 * area)
    uu = ((x * x + x * nx + nx * nx) @ cross) / (12 * area) - u * u
    vv = ((y * y + y * ny + ny * ny) @ cross) / (12 * area) - v * v
    uv = ((x * ny + 2 * x * y + 2 * nx * ny + nx * y) @ cross) / (24 * area) - u * v
    return Ellipse(outline[0] + np.array([u, v]), np.array([[uu, uv], [uv, vv]]))
