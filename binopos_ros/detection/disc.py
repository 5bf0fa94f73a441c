"""From the centre of a disc's outline to the image of the disc's centre.

They differ: what is nearer is seen larger, and refraction bends the outline out of an ellipse.
At a tilt of 60 degrees and 40 px across the difference is some tenths of a pixel.

How large it is depends on where the disc is and how it lies, which is known only when both images
have been brought together. So this is applied where positions are made: triangulate the outlines'
centres, take the offsets at that position, and triangulate again. The first position is wrong by
less than a thousandth of the distance, so its offsets are right to a thousandth of themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .target import Array, Ellipse

Project = Callable[[Array], Sequence[Array]]
"""Projects points (N, 3) m to pixels (N, 2) in each camera, as `StereoRig.project` does."""

RIM_POINTS = 96
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
    offsets = []
    for image in project(np.vstack([position, _rim(position, normal, diameter)])):
        if not np.isfinite(image).all():
            msg = f'the disc at {np.round(position, 3).tolist()} m is not seen whole'
            raise DetectionError(msg)
        offsets.append(_enclosed(image[1:]).centre - image[0])
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
        images = project(_rim(position, normal_of(slant), diameter))
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


def _rim(position: Array, normal: Array, diameter: float) -> Array:
    axes = np.linalg.svd(_unit(np.asarray(normal, float))[None])[2][1:]
    angle = np.arange(RIM_POINTS) * (2 * np.pi / RIM_POINTS)
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) * diameter / 2
    rim: Array = position + circle @ axes
    return rim


def _enclosed(polygon: npt.NDArray[np.float64]) -> Ellipse:
    """Centroid and second central moments of the area within a polygon (N, 2), by Green."""
    origin = polygon.mean(0)
    x, y = (polygon - origin).T
    nx, ny = np.roll(x, -1), np.roll(y, -1)
    cross = x * ny - nx * y
    area = cross.sum() / 2
    u, v = ((x + nx) @ cross) / (6 * area), ((y + ny) @ cross) / (6 * area)
    uu = ((x * x + x * nx + nx * nx) @ cross) / (12 * area) - u * u
    vv = ((y * y + y * ny + ny * ny) @ cross) / (12 * area) - v * v
    uv = ((x * ny + 2 * x * y + 2 * nx * ny + nx * y) @ cross) / (24 * area) - u * v
    return Ellipse(origin + np.array([u, v]), np.array([[uu, uv], [uv, vv]]))
