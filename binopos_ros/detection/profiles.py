"""Tables of a blurred edge, by the distance from it in blurs: quicker than exponentials."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from .target import Array
from .window import Grid

PROFILE_REACH, PROFILE_STEPS = 6, 170
"""How far the table of the edge's profile goes, in blurs, and its steps per blur: so fine that
what it rounds off is less than a camera does."""


def _distances() -> Array:
    reach = PROFILE_REACH * PROFILE_STEPS
    return np.arange(-reach, reach + 1) / PROFILE_STEPS


@cache
def profiles() -> Grid:
    """By distance in blurs: the slope, what blur and profile change, the shares."""
    z = _distances()
    slope = np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
    share = np.array([math.erfc(each / math.sqrt(2)) / 2 for each in z])
    rows = [slope, z * slope, (z * z - 1) * slope, (z * z - 3) * z * slope, share, 1 - share]
    return np.array(rows, np.float32)


@cache
def depths() -> Grid:
    """By distance in blurs: the depth of a ball's surface below its outline."""
    return _blurred_roots(-_distances()).astype(np.float32)


def _blurred_roots(depth: Array) -> Array:
    """The square root of what is above 0, blurred by 1: how a ball's surface turns away."""
    step = 0.01
    # Of u = s^2 the root is s, so nothing is steep where the surface begins.
    s = np.arange(step / 2, math.sqrt(PROFILE_REACH * 2.5), step)
    kernel = np.exp(-0.5 * (depth[:, None] - s * s) ** 2) / math.sqrt(2 * math.pi)
    roots: Array = (kernel * (2 * s * s * step)).sum(1)
    return roots
