"""Are five distortion terms adequate for a lens, and if not, are eight better?

Adequacy: the residuals of an adequate lens point inwards and outwards equally often at every
radius. For each ring of the picture the mean radial residual is formed per view, and its mean
over the views is compared with its own scatter (points of one view err together, views do not).
The sum of the squared ratios is about chi-squared, one degree of freedom per ring.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment
from binopos_ros.calibration.views.view import View

RINGS = 8
FEWEST_VIEWS_PER_RING = 4
FEWEST_POINTS_PER_RING = 3
SIGNIFICANCE = 0.001
BETTER = 2.0  # standard errors by which a larger model must win on held-out views


@dataclass(frozen=True)
class Adequacy:
    """The outcome: probability of residuals so systematic by chance, and the rings' means.

    Attributes:
        probability: in 0 .. 1; an adequate lens gives any value with equal chance.
        radial: (R,) mean radial residual of the rings that hold enough points (px), and
            `deviations` (R,) their own.
    """

    probability: float
    radial: np.ndarray
    deviations: np.ndarray

    @property
    def adequate(self) -> bool:
        """Whether nothing speaks against the lens model."""
        return self.probability >= SIGNIFICANCE


def adequacy(fit: Adjustment, views: Sequence[View], side: int) -> Adequacy:
    """Test one camera's lens model on the residuals of a calibration."""
    camera = fit.state.cameras[side]
    reach = float(np.hypot(*camera.size)) / 2.0
    means: list[list[float]] = [[] for _ in range(RINGS)]
    for view, residuals, inliers in zip(views, fit.residuals, fit.inliers, strict=True):
        good = inliers[side]
        away = view.pixels[side][good] - camera.centre
        radius = np.linalg.norm(away, axis=1)
        radial = np.sum(residuals[side][good] * away, axis=1) / np.maximum(radius, 1.0)
        ring = np.minimum((radius / reach * RINGS).astype(int), RINGS - 1)
        for i in range(RINGS):
            if np.sum(ring == i) >= FEWEST_POINTS_PER_RING:
                means[i].append(float(radial[ring == i].mean()))
    rings = [i for i in range(RINGS) if len(means[i]) >= FEWEST_VIEWS_PER_RING]
    mean = np.array([np.mean(means[i]) for i in rings])
    deviation = np.array([np.std(means[i], ddof=1) / math.sqrt(len(means[i])) for i in rings])
    deviation = np.maximum(deviation, 1e-3)  # a thousandth of a pixel never matters
    scores = [
        _normal_score(float(t), len(means[i]) - 1)
        for i, t in zip(rings, mean / deviation, strict=True)
    ]
    probability = chi_squared_tail(float(np.sum(np.square(scores))), len(rings))
    return Adequacy(probability, mean, deviation)


def better_by(first: np.ndarray, second: np.ndarray) -> float:
    """By how many standard errors the second model is better on held-out views.

    The signed ranks of the views' ratios (F. Wilcoxon, Biometrics Bulletin 1, 1945): a view that
    dominates says no more than that it agrees, and all of seven give 2.4.

    Args:
        first, second: (V,) held-out mean squares of the same views (px^2).
    """
    gain = np.log(np.maximum(first, 1e-12) / np.maximum(second, 1e-12))
    rank = np.argsort(np.argsort(np.abs(gain))) + 1.0
    return float(np.sum(rank * np.sign(gain)) / np.sqrt(np.sum(rank**2)))


def _normal_score(t: float, freedom: int) -> float:
    """Student's t as a standard normal deviate (D. L. Wallace, Ann. Math. Statist. 30, 1959)."""
    size = math.sqrt(freedom * math.log1p(t * t / freedom))
    return (8 * freedom + 1) / (8 * freedom + 3) * size


def chi_squared_tail(value: float, freedom: int) -> float:
    """The chance of a larger value (Wilson and Hilferty, PNAS 17, 1931)."""
    if freedom < 1:
        return 1.0
    spread = 2.0 / (9.0 * freedom)
    score = ((value / freedom) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread)
    return 0.5 * math.erfc(score / math.sqrt(2.0))
