"""The centre of a target's outline: a first estimate by moments, and what the fit makes of it.

The estimate weighs each pixel by the share of it that the target covers, for which its colour is
projected on the line from the surroundings' colour to the target's. It is good to a tenth of a
pixel, whatever found the target; `edge` does the rest.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from .edge import BAND, EdgeFit, Measured
from .errors import DetectionError
from .images import Frame
from .target import Array, Ellipse
from .window import Grid, Window

RING = 6.0
LEAST_CONTRAST = 3.0

MOMENTS_ERROR, MOMENTS_SHARE = 0.15, 0.01
"""Standard deviation of the estimate by moments, rounded: px, and as a share of the semi-axis."""

SIGMAS = 3.0
"""How far the fit may end from the estimate by moments, in standard deviations of both."""


def measure(frame: Frame, seed: Ellipse) -> Measured:
    """Measure the outline near a seed that lies within a few pixels of it.

    Raises DetectionError where no outline can be measured there.
    """
    # Two seeds of the same target agree after this to much less than the steps they are rounded
    # to, so the fit starts from one and the same outline however the target was found.
    start = _rounded(_by_moments(frame, seed))
    fitted = EdgeFit(frame, start).measured()
    du, dv = (fitted.outline.centre - start.centre).tolist()
    shift = du * du + dv * dv
    spread = (MOMENTS_ERROR + MOMENTS_SHARE * start.semi_axes[0]) ** 2
    if shift <= SIGMAS**2 * (float(np.trace(fitted.covariance)) / 2 + spread):
        return fitted
    # One of the two is wrong, by no more than they differ; of a fit gone astray nothing holds.
    return Measured(_by_moments(frame, start), np.eye(2) * (shift / 2 + spread))


def _rounded(ellipse: Ellipse) -> Ellipse:
    (a, b), (_, d) = ellipse.moments.tolist()
    wide, high = (max(round(math.sqrt(each) * 8), 4) / 8 for each in (a, d))
    tilt = min(max(round(b / math.sqrt(a * d) * 32) / 32, -0.97), 0.97)
    cross = tilt * wide * high
    moments = np.array([[wide**2, cross], [cross, high**2]])
    return Ellipse(np.round(ellipse.centre * 4) / 4, moments)


def _by_moments(frame: Frame, around: Ellipse) -> Ellipse:
    """The outline from the moments of the share of each pixel that the target covers."""
    window = Window(frame, around, BAND + RING)
    outer, inside = window.within(BAND), window.within(0, 0.7)
    ring = window.within(BAND + RING) ^ outer
    background = cv2.mean(window.pixels, ring.view(np.uint8))[:3]
    colour = cv2.mean(window.pixels, inside.view(np.uint8))[:3]
    axis = [inner - outer for inner, outer in zip(colour, background, strict=True)]
    power = math.hypot(*axis) ** 2
    if power < LEAST_CONTRAST**2:
        msg = 'the patch is of the same colour as its surroundings'
        raise DetectionError(msg)
    level = sum(each * outer for each, outer in zip(axis, background, strict=True))
    row = np.array([[*axis, -level]], np.float32) / np.float32(power)
    share = np.asarray(cv2.transform(window.pixels, row), np.float32)
    share[window.within(-BAND)] = 1
    share *= outer
    area, offset, spread = _moments(share, window.x, window.y)
    if not (area > 4 and spread[0, 0] > 0.1 and spread[1, 1] > 0.1):
        msg = 'no area is left within the outline'
        raise DetectionError(msg)
    if not spread[0, 0] * spread[1, 1] - spread[0, 1] ** 2 > 0.01:
        msg = 'the area within the outline has no width'
        raise DetectionError(msg)
    return Ellipse(around.centre + offset, spread)


def _moments(weights: Grid, x: Grid, y: Grid) -> tuple[float, Array, Array]:
    """The weights' sum, centroid (2,) and second central moments (2, 2)."""
    columns = weights.sum(0, dtype=np.float64)
    rows = weights.sum(1, dtype=np.float64)
    area = float(columns.sum())
    u, v = columns @ x / area, rows @ y / area
    cross = float(y @ weights @ x) / area - u * v
    spread = np.array(
        [[columns @ (x * x) / area - u * u, cross], [cross, rows @ (y * y) / area - v * v]]
    )
    return area, np.array([u, v]), spread
