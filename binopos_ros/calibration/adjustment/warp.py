"""A board that is not flat: two bends and a twist, estimated with the rig.

A board bowed by a millimetre moves focal lengths by many of their deviations, and its residuals
look like a lens. Its height over the plane of its corners is taken as

    z(u, v) = a u^2 + b v^2 + c u v,   u, v in -1 .. 1 over the corners,

in metres at the edge; a plane's worth of it is the pose's. Every other unknown eliminated, the
three are a Newton step away, and the flat board's own step tells whether they are there at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adequacy import SIGNIFICANCE, chi_squared_tail
from binopos_ros.calibration.adjustment.adjust import Adjustment, Prior, adjust
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import cross_matrices

TERMS = 3
ROUNDS = 2  # the corners follow the shape nearly linearly


@dataclass(frozen=True)
class Bent:
    """An adjustment with the board's own shape.

    Attributes:
        fit: of rig and poses, its covariance that of a board whose shape is known.
        views: with the board's points as they lie.
        warp: (3,) a, b, c (m); deviations: (3,) theirs.
        uncertainty: (P, P) by which the rig's covariance grows because the shape was estimated.
    """

    fit: Adjustment
    views: tuple[View, ...]
    warp: np.ndarray
    deviations: np.ndarray
    uncertainty: np.ndarray


def estimate_warp(
    fit: Adjustment, views: Sequence[View], prior: Prior | None = None, robust: bool = True
) -> Bent | None:
    """The adjustment with the board's shape estimated; None where a flat board does as well.

    Args:
        fit: of flat boards, converged.
        views: all of one board.
        prior: as in `adjust`; robust: likewise.
    """
    warp = np.zeros(TERMS)
    bent, current = list(views), fit
    for attempt in range(ROUNDS):
        step, covariance, uncertainty = _newton(current, bent, prior)
        if not attempt:
            square = float(step @ np.linalg.solve(covariance, step))
            if not chi_squared_tail(square, TERMS) < SIGNIFICANCE:
                return None
        warp = warp + step
        bent = [replace(view, points=_bend(view.points, warp)) for view in views]
        current = adjust(current.state, current.poses, bent, fit.free, prior, robust=robust)
    return Bent(current, tuple(bent), warp, np.sqrt(np.diag(covariance)), uncertainty)


def _bend(points: np.ndarray, warp: np.ndarray) -> np.ndarray:
    bent = points.copy()
    bent[:, 2] += _shape(points) @ warp
    return bent


def _shape(points: np.ndarray) -> np.ndarray:
    """(N, 3) u^2, v^2 and u v."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    u, v = ((2.0 * points[:, :2] - low - high) / (high - low)).T
    return np.stack([u * u, v * v, u * v], axis=1)


def _newton(
    fit: Adjustment, views: Sequence[View], prior: Prior | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The step of the three terms, their covariance, and what they add to the rig's."""
    rig = int(fit.free.sum())
    information = np.zeros((rig + TERMS, rig + TERMS))
    right = np.zeros(rig + TERMS)
    for view, pose, inliers, residuals in zip(
        views, fit.poses, fit.inliers, fit.residuals, strict=True
    ):
        by_rest, by_pose, rest = [], [], []
        for side, rows in enumerate(inliers):
            turned = view.points[rows] @ pose.rotation.T
            seen = project(fit.state, side, turned + pose.translation)
            turns = seen.by_point @ -cross_matrices(turned)
            lifts = (seen.by_point @ pose.rotation[:, 2])[:, :, None]
            lifts = lifts * _shape(view.points)[rows][:, None, :]
            by_rest.append(np.concatenate([seen.by_rig[:, :, fit.free], lifts], axis=2))
            by_pose.append(np.concatenate([turns, seen.by_point], axis=2))
            rest.append(residuals[side][rows])
        own = np.concatenate(by_rest).reshape(-1, rig + TERMS) / fit.sigma
        posed = np.concatenate(by_pose).reshape(-1, 6) / fit.sigma
        left = np.concatenate(rest).ravel() / fit.sigma
        if not len(left):
            continue
        # What the pose cannot take up.
        across = np.linalg.qr(posed)[0]
        own = own - across @ (across.T @ own)
        information += own.T @ own
        right += own.T @ left
    if prior is not None:
        known = prior.information[np.ix_(fit.free, fit.free)]
        information[:rig, :rig] += known
        right[:rig] -= (prior.information @ fit.state.minus(prior.state))[fit.free]
    scale = 1.0 / np.sqrt(np.diag(information))
    inverse = np.linalg.pinv(information * np.outer(scale, scale), hermitian=True)
    covariance = inverse * np.outer(scale, scale)
    uncertainty = np.zeros((len(fit.free), len(fit.free)))
    uncertainty[np.ix_(fit.free, fit.free)] = covariance[:rig, rig:] @ np.linalg.solve(
        covariance[rig:, rig:], covariance[rig:, :rig]
    )
    return (covariance @ right)[rig:], covariance[rig:, rig:], uncertainty
