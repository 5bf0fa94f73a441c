"""What every method of this room gives: points with their covariance, or reasons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

NOT_FINITE = 'a pixel or a covariance is not a finite number'


@dataclass(frozen=True)
class Triangulation:
    """Points and how well they are known; a single pair gives the shapes without N.

    Attributes:
        points: (N, 3) m, rig frame; nan where there is none.
        covariances: (N, 3, 3) m^2.
        residuals: (N, 4) px: observed minus predicted, left u, v, right u, v.
        reasons: (N,) of str: '' where the point is good, else why it is nan.

    """

    points: FloatArray
    covariances: FloatArray
    residuals: FloatArray
    reasons: NDArray[np.object_]


def no_points(count: int, reason: str = '') -> Triangulation:
    """Return `count` pairs that have no point, or none yet."""
    return Triangulation(
        np.full((count, 3), np.nan),
        np.full((count, 3, 3), np.nan),
        np.full((count, 4), np.nan),
        np.full(count, reason, dtype=object),
    )
