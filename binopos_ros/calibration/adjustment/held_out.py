"""Cross-validation: each view judged by a calibration that has not seen it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.adjustment.adjust import NEARLY, Adjustment, Prior, adjust
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState, places_seen_through

FOLDS = 5


@dataclass(frozen=True)
class HeldOut:
    """The outcome.

    Attributes:
        rms: of the reprojection with the board's pose fitted to all pictures of a view (px).
        transfer: of the right picture's points with the pose fitted to the left alone (px); nan
            of one camera.
        squares: (V,) each view's mean square (px^2).
    """

    rms: float
    transfer: float
    squares: np.ndarray


def cross_validate(fit: Adjustment, views: Sequence[View], prior: Prior | None = None) -> HeldOut:
    """Judge each view by the rig that the other folds' views give."""
    count = len(views)
    squares = np.full(count, np.nan)
    transfers: list[np.ndarray] = []
    lengths: list[np.ndarray] = []
    none = np.zeros(len(fit.free), bool)
    for fold in range(min(FOLDS, count)):
        out = [i for i in range(count) if i % FOLDS == fold]
        rest = [i for i in range(count) if i % FOLDS != fold]
        poses, seen = [fit.poses[i] for i in rest], [views[i] for i in rest]
        rig = adjust(fit.state, poses, seen, fit.free, prior, converged=NEARLY).state
        test = [views[i] for i in out]
        judged = adjust(rig, [fit.poses[i] for i in out], test, none, robust=False, sigma=1.0)
        for i, residuals in zip(out, judged.residuals, strict=True):
            both = np.concatenate([r[np.isfinite(r).all(axis=1)] for r in residuals])
            squares[i] = np.mean(np.sum(both**2, axis=1))
            lengths.append(np.sum(both**2, axis=1))
        left_only = [
            (i, View(v.name, v.points, v.pixels[:1]))
            for i, v in zip(out, test, strict=True)
            if len(rig.cameras) == 2
            and all(np.isfinite(p).all(axis=1).sum() >= 4 for p in v.pixels)
        ]
        if left_only:
            transfers += _transfer(rig, fit, left_only, views)
    return HeldOut(
        float(np.sqrt(np.mean(np.concatenate(lengths)))),
        float(np.sqrt(np.mean(np.concatenate(transfers)))) if transfers else float('nan'),
        squares,
    )


def _transfer(
    rig: RigState,
    fit: Adjustment,
    left_only: list[tuple[int, View]],
    views: Sequence[View],
) -> list[np.ndarray]:
    start = [fit.poses[i] for i, _ in left_only]
    before = {place: rig.interfaces[place] for place in places_seen_through(rig, LEFT)}
    left = RigState(rig.cameras[:1], interfaces=before)
    none = np.zeros(len(left.names), bool)
    posed = adjust(left, start, [view for _, view in left_only], none, robust=False, sigma=1.0)
    squares = []
    for (i, _), pose in zip(left_only, posed.poses, strict=True):
        error = views[i].pixels[RIGHT] - project(rig, RIGHT, pose.apply(views[i].points)).pixels
        error = error[np.isfinite(error).all(axis=1)]
        squares.append(np.sum(error**2, axis=1))
    return squares
