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
from .target import Ellipse
from .window import Window

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
    # Never in the middle of a pixel, where the outline's distance has no direction.
    centre = np.array([math.floor(each * 4) / 4 + 0.125 for each in ellipse.centre.tolist()])
    return Ellipse(centre, moments)


def _by_moments(frame: Frame, around: Ellipse) -> Ellipse:
    """The outline from the moments of the share of each pixel that the target covers."""
    window = Window(frame, around, BAND + RING)
    outer = window.within(BAND)
    background = cv2.mean(window.pixels, window.within(BAND + RING) - outer)
    colour = cv2.mean(window.pixels, window.within(0, 0.7))
    axis = [inner - outer for inner, outer in zip(colour[:3], background[:3], strict=True)]
    power = sum(each * each for each in axis)
    if power < LEAST_CONTRAST**2:
        msg = 'the patch is of the same colour as its surroundings'
        raise DetectionError(msg)
    level = sum(each * outer for each, outer in zip(axis, background[:3], strict=True))
    row = np.array([[each / power for each in (*axis, -level)]], np.float32)
    share = cv2.copyTo(cv2.transform(window.pixels.astype(np.float32), row), outer)
    np.copyto(share, 1, where=window.within(-BAND).view(np.bool_))
    m = cv2.moments(share)
    area = m['m00']
    if not area > 4:
        msg = 'no area is left within the outline'
        raise DetectionError(msg)
    uu, uv, vv = m['mu20'] / area, m['mu11'] / area, m['mu02'] / area
    if not (uu > 0.1 and vv > 0.1 and uu * vv - uv * uv > 0.01):
        msg = 'the area within the outline has no width'
        raise DetectionError(msg)
    centre = np.array([window.left + m['m10'] / area, window.top + m['m01'] / area])
    return Ellipse(centre, np.array([[uu, uv], [uv, vv]]))
