"""How a disc is held, from its outlines in both pictures."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from binopos_ros.optics.disc import Project, enclosed_moments, unit_rim, unit_vector

from .errors import DetectionError
from .target import Array, Ellipse

TILTS = np.radians([0.5, 15, 30, 45, 60, 75])
AZIMUTHS = np.radians(np.arange(0, 360, 30))
REFINEMENTS = 8


def estimate_normal(
    project: Project, outlines: Sequence[Ellipse], position: Array, diameter: float
) -> Array:
    """Give the disc's unit normal (3,), towards the cameras, from its outlines.

    The outlines' second moments are compared with those of discs of all orientations. One camera
    leaves two orientations that look nearly alike; two cameras tell them apart, the better the
    wider the baseline and the larger the tilt.
    """
    position = np.asarray(position, float)
    forward = unit_vector(position)
    across = np.linalg.svd(forward[None])[2][1:]

    def normal_of(slant: Array) -> Array:
        return unit_vector(slant @ across - forward)

    def misfit(slant: Array) -> Array:
        rests = []
        rim = unit_rim(tuple(normal_of(slant).tolist()))
        images = project(position + diameter * rim)
        for image, outline in zip(images, outlines, strict=True):
            expected = enclosed_moments(image)
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
