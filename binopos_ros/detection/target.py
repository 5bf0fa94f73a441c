"""What the detector says: a target, or why there is none, and every candidate it looked at."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Ellipse:
    """An outline: centre (2,) px and the second central moments (2, 2) px^2 of what it encloses.

    The moments of an ellipse are a quarter of its squared semi-axes.
    """

    centre: Array
    moments: Array

    @property
    def semi_axes(self) -> tuple[float, float]:
        """The major and the minor semi-axis, px."""
        (a, b), (_, d) = self.moments.tolist()
        mean, spread = (a + d) / 2, math.hypot((a - d) / 2, b)
        return 2 * math.sqrt(max(mean + spread, 0.0)), 2 * math.sqrt(max(mean - spread, 0.0))

    @property
    def angle(self) -> float:
        """The major axis's direction, rad from the u axis towards the v axis."""
        (a, b), (_, d) = self.moments.tolist()
        return 0.5 * math.atan2(2 * b, a - d)


@dataclass(frozen=True)
class Target:
    """A target in one image.

    centre (2,) is the centre of the area within the outline, px, and covariance (2, 2) that of
    its error, px^2; diameter is the outline's major axis, px.
    """

    centre: Array
    covariance: Array
    diameter: float
    outline: Ellipse


@dataclass(frozen=True)
class Candidate:
    """A red patch that was looked at.

    contrast is its redness above that of its surroundings, redness its own (both of
    `colour.redness`, -1 to 1), fit the share in which patch and ellipse agree (0 to 1), score
    what it is ranked by. reason says why it was refused, and is empty for the one chosen.
    """

    outline: Ellipse
    contrast: float
    redness: float
    fit: float
    score: float
    reason: str = ''


@dataclass(frozen=True)
class Detection:
    """The outcome of one image; reason is empty where there is a target.

    threshold is the contrast that the target had to have at its place, or in most of the image
    where there is none (it follows the noise there), tracked whether a window about the
    prediction was all that was searched.
    """

    target: Target | None
    reason: str = ''
    candidates: tuple[Candidate, ...] = ()
    threshold: float = float('nan')
    tracked: bool = False
