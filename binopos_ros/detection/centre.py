"""The centre of a target's outline: what the fit of its edge makes of the outline by moments."""

from __future__ import annotations

import math

import numpy as np

from .edge import EdgeFit, Measured
from .images import Frame
from .target import Ellipse

MOMENTS_ERROR, MOMENTS_SHARE = 0.15, 0.01
"""Standard deviation of the outline by moments, rounded: px, and as a share of the semi-axis."""

SIGMAS = 3.0
"""How far the fit may end from the outline by moments, in standard deviations of both."""


def measure(frame: Frame, seed: Ellipse) -> Measured:
    """Measure the outline near one that is good to a tenth of a pixel.

    Raises DetectionError where no outline can be measured there.
    """
    # Whatever differs in the last digits where a target is followed is rounded away, so the fit
    # starts from one and the same outline however the target was found.
    start = _rounded(seed)
    fitted = EdgeFit(frame, start).measured()
    (u, v), (start_u, start_v) = fitted.outline.centre.tolist(), start.centre.tolist()
    shift = (u - start_u) ** 2 + (v - start_v) ** 2
    spread = (MOMENTS_ERROR + MOMENTS_SHARE * start.semi_axes[0]) ** 2
    (a, _), (_, d) = fitted.covariance.tolist()
    if shift <= SIGMAS**2 * ((a + d) / 2 + spread):
        return fitted
    # One of the two is wrong, by no more than they differ; of a fit gone astray nothing holds.
    return Measured(seed, np.eye(2) * (shift / 2 + spread))


def _rounded(ellipse: Ellipse) -> Ellipse:
    (a, b), (_, d) = ellipse.moments.tolist()
    wide, high = (max(round(math.sqrt(each) * 8), 4) / 8 for each in (a, d))
    tilt = min(max(round(b / math.sqrt(a * d) * 32) / 32, -0.97), 0.97)
    cross = tilt * wide * high
    moments = np.array([[wide**2, cross], [cross, high**2]])
    # Never in the middle of a pixel, where the outline's distance has no direction.
    centre = np.array([math.floor(each * 4) / 4 + 0.125 for each in ellipse.centre.tolist()])
    return Ellipse(centre, moments)
