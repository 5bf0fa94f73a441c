"""Are the errors of one view's points independent? If not, how much wider the covariance is.

Least squares takes them so. On rendered boards they are; on photographs a bent board, a print that
is not to scale, blur or a lens that the model misses move neighbouring corners alike, and many
corners then tell less than they seem to. Views err independently, so they show it: view v pulls
the rig's parameters by its score g_v (its pose eliminated), of covariance F (I_v - I_v C I_v) at
the optimum, with I_v its information, C the covariance and F = 1 for independent points. So

    F = sum_v g_v' C g_v / sum_v tr M_v,   M_v = C I_v - C I_v C I_v,

is about chi-squared over its degrees of freedom, (sum tr M_v)^2 / sum tr M_v^2 (Satterthwaite).
Where F is significant, the covariance is C (F I + P) C, with I the pictures' information and P the
prior's (the sandwich of H. White, Econometrica 50, 1982, with one factor for all directions).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment, Prior, view_score
from binopos_ros.calibration.views.view import View

FEWEST_VIEWS = 5
SCORE = 3.09  # of the normal distribution: one set of independent points in 1000 lies beyond


@dataclass(frozen=True)
class VarianceFactor:
    """value: F above; freedom: its degrees of freedom."""

    value: float
    freedom: float

    @property
    def significant(self) -> bool:
        """Whether independent points would hardly give it (Wilson and Hilferty, PNAS 17, 1931)."""
        spread = 2.0 / (9.0 * max(self.freedom, 1.0))
        return self.value > (1.0 - spread + SCORE * math.sqrt(spread)) ** 3


def variance_factor(fit: Adjustment, views: Sequence[View]) -> VarianceFactor:
    """How the views' scores scatter, as a multiple of what independent points would give."""
    free = fit.free
    covariance = fit.covariance[np.ix_(free, free)]
    scatter = expected = squares = 0.0
    for view, pose, inliers in zip(views, fit.poses, fit.inliers, strict=True):
        information, score = view_score(fit.state, pose, view, free, fit.sigma, inliers)
        own = covariance @ information
        mixed = own - own @ own
        scatter += float(score @ covariance @ score)
        expected += float(np.trace(mixed))
        squares += float(np.sum(mixed * mixed.T))
    if expected <= 0.0:
        return VarianceFactor(1.0, 0.0)
    return VarianceFactor(scatter / expected, expected**2 / squares)


def widened(fit: Adjustment, views: Sequence[View], prior: Prior | None = None) -> Adjustment:
    """The adjustment with the covariance that its views' scatter shows, if that is larger."""
    if len(views) < FEWEST_VIEWS or not fit.free.any():
        return fit
    factor = variance_factor(fit, views)
    if not factor.significant:
        return fit
    covariance = factor.value * fit.covariance
    if prior is not None:
        known = fit.covariance @ prior.information @ fit.covariance
        covariance -= (factor.value - 1.0) * known
    return replace(fit, covariance=covariance, variance_factor=factor.value)
