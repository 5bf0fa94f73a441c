"""Is the board bent? Its shape is kept where that predicts views better that it has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adequacy import BETTER, better_by
from binopos_ros.calibration.adjustment.adjust import Adjustment, Prior
from binopos_ros.calibration.adjustment.held_out import HeldOut, cross_validate
from binopos_ros.calibration.adjustment.warp import TERMS, Bent, estimate_warp
from binopos_ros.calibration.views.view import View


@dataclass(frozen=True)
class BoardShape:
    """How a board is bent.

    Attributes:
        warp: (3,) its bends along rows and columns and its twist, at the edge (m; see `warp`).
        deviations: (3,) theirs. All are zero where a flat board does as well.
    """

    warp: np.ndarray
    deviations: np.ndarray

    @property
    def in_words(self) -> str:
        """Whether the board is flat, and if not how it is bent."""
        if not self.warp.any():
            return 'flat, as far as these pictures show'
        along, across, twist = 1000.0 * self.warp
        spread = 1000.0 * float(self.deviations.max())
        return (
            f'bowed by {along:+.2f} mm along its rows, {across:+.2f} mm along its columns, '
            f'twisted by {twist:+.2f} mm at its edges (+- {spread:.2f}): taken into account'
        )


FLAT = BoardShape(np.zeros(TERMS), np.zeros(TERMS))


def bent_board(
    fit: Adjustment,
    views: Sequence[View],
    prior: Prior | None,
    flat: HeldOut | None = None,
) -> tuple[Bent, HeldOut] | None:
    """The adjustment with the board's shape estimated; None where a flat one does as well.

    Args:
        fit: of a flat board, converged.
        views: all of one board.
        prior: as in `adjust`.
        flat: how the flat board does on held-out views, where that is known already.
    """
    bent = estimate_warp(fit, views, prior)
    if bent is None:
        return None
    if flat is None:
        flat = cross_validate(fit, views, prior)
    judged = cross_validate(bent.fit, bent.views, prior)
    if better_by(flat.squares, judged.squares) < BETTER:
        return None
    return bent, judged


def with_uncertain_shape(fit: Adjustment, bent: Bent) -> tuple[Adjustment, BoardShape]:
    """Add to an adjustment's covariance what the shape's own uncertainty makes of it.

    Args:
        fit: of the bent board, its covariance widened or not (see `noise`).
        bent: where the shape comes from.
    """
    covariance = fit.covariance + fit.variance_factor * bent.uncertainty
    deviations = bent.deviations * np.sqrt(fit.variance_factor)
    return replace(fit, covariance=covariance), BoardShape(bent.warp, deviations)
