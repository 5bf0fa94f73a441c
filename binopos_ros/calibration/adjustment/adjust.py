"""Robust bundle adjustment of a rig and the boards it has seen (Levenberg-Marquardt).

Unknown are some of the rig's parameters and one pose per view. The poses meet only the rig, not
each other, so each step eliminates them (Schur complement) and solves for the rig alone; what is
left is also the inverse of the rig's covariance.

Outliers: Huber's weights until convergence, then points farther than `REJECT` standard
deviations are left out and the rest counts in full, so that the covariance is that of least
squares (B. Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import RigState, cross_matrices, exponential

HUBER = 2.5  # standard deviations of the 2-D residual; 4 % of clean points lie beyond
REJECT = 4.5  # one clean point in 25000 lies beyond
STEPS = 60
CONVERGED = 1e-9  # relative decrease of the cost
NEARLY = 1e-5  # the same, while the weights still change
HELD = 1e15  # rad^-2, information that holds an orientation
LEAST_SIGMA = 1e-4  # px; below it the data are synthetic and exact


@dataclass(frozen=True)
class Prior:
    """What is known of the rig beforehand: information (P, P) about `state`'s parameters."""

    state: RigState
    information: np.ndarray


@dataclass(frozen=True)
class Adjustment:
    """The outcome.

    Attributes:
        state: the rig.
        poses: of the boards, rig frame.
        covariance: (P, P) of all the rig's parameters, zero where held fixed.
        free: (P,) which parameters were estimated.
        sigma: standard deviation of a pixel coordinate (px).
        residuals: per view and camera (N, 2), measured minus computed (px), nan where not seen.
        inliers: per view and camera (N,).
        variance_factor: by which the pictures' part of the covariance is wider than that of
            independent points (see `noise`).
    """

    state: RigState
    poses: tuple[Pose, ...]
    covariance: np.ndarray
    free: np.ndarray
    sigma: float
    residuals: tuple[tuple[np.ndarray, ...], ...]
    inliers: tuple[tuple[np.ndarray, ...], ...]
    variance_factor: float = 1.0

    @property
    def effective_sigma(self) -> float:
        """Standard deviation (px) of independent points that would tell as much."""
        return self.sigma * float(np.sqrt(self.variance_factor))

    def deviation(self, name: str) -> float:
        """The standard deviation of one parameter."""
        place = self.state.names.index(name)
        return float(np.sqrt(self.covariance[place, place]))

    def rms(self, view: int | None = None, side: int | None = None) -> float:
        """Root mean square of the residual's length over all points seen (px), outliers too; nan
        where nothing was seen."""
        views = range(len(self.residuals)) if view is None else [view]
        sides = range(len(self.state.cameras)) if side is None else [side]
        squares = [np.sum(self.residuals[v][s] ** 2, axis=1) for v in views for s in sides]
        seen = np.concatenate(squares)
        seen = seen[np.isfinite(seen)]
        return float(np.sqrt(seen.mean())) if len(seen) else float('nan')


@dataclass
class _Normal:
    """The normal equations: rig block, pose blocks, and what couples them."""

    rig: np.ndarray
    rig_right: np.ndarray
    pose: np.ndarray
    pose_right: np.ndarray
    coupling: np.ndarray
    residuals: np.ndarray
    cost: float


def adjust(
    start: RigState,
    poses: Sequence[Pose],
    views: Sequence[View],
    free: np.ndarray,
    prior: Prior | None = None,
    robust: bool = True,
    sigma: float | None = None,
    converged: float = CONVERGED,
) -> Adjustment:
    """Estimate the free parameters of the rig and all poses.

    Args:
        start: first guess; also the values of the parameters that are not free.
        poses: first guess, one per view.
        views: what was seen.
        free: (P,) bool in the order of `start.names`.
        prior: information on the parameters (absolute, in their own units).
        robust: reject outlying points.
        sigma: standard deviation of a pixel coordinate (px) where known; else estimated.
        converged: relative decrease of the cost that ends the descent; `NEARLY` for a start.

    Raises:
        CalibrationError: nothing to fit, or the points do not determine the parameters.
    """
    if not views:
        raise CalibrationError('no view of a board to calibrate from')
    batch = _Batch(views, len(start.cameras))
    scale = sigma if sigma is not None else 1.0
    state, current = start, list(poses)
    weights = np.ones(batch.count)
    rounds = 4 if robust else 1
    for _ in range(rounds):
        state, current, residual = _descend(
            batch, state, current, free, prior, weights, scale, NEARLY if robust else converged
        )
        if sigma is None:
            scale = max(_robust_sigma(residual), LEAST_SIGMA)
        if not robust:
            break
        length = np.sqrt(np.sum(residual**2, axis=1)) / scale
        before, weights = weights, np.minimum(1.0, HUBER / np.maximum(length, 1e-12))
        if np.abs(weights - before).max() < 0.02:
            break
    inlier = np.ones(batch.count, bool)
    if robust:
        for attempt in range(2):
            earlier, inlier = inlier, np.sum(residual**2, axis=1) <= (REJECT * scale) ** 2
            if attempt and (inlier == earlier).all():
                break
            state, current, residual = _descend(
                batch, state, current, free, prior, inlier.astype(float), scale, converged
            )
    if sigma is None:
        surplus = int(batch.coordinates[inlier].sum()) - int(free.sum()) - 6 * len(current)
        scale = max(_least_squares_sigma(residual, inlier, surplus), LEAST_SIGMA)
        if prior is not None and prior.information.any():
            # The prior's weight against the pictures' depends on the scale.
            state, current, residual = _descend(
                batch, state, current, free, prior, inlier.astype(float), scale, converged
            )
    normal = batch.normal(state, current, free, inlier.astype(float), scale, prior)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = _inverse(_reduced(normal)[0], state, free)
    return Adjustment(
        state,
        tuple(current),
        covariance,
        np.asarray(free, bool),
        scale,
        batch.split(residual),
        batch.split(inlier, fill=False),
    )


def view_information(
    state: RigState, pose: Pose, view: View, free: np.ndarray, sigma: float
) -> np.ndarray:
    """(F, F) what one view, its pose unknown, tells about the free parameters of the rig."""
    batch = _Batch([view], len(state.cameras))
    return _reduced(batch.normal(state, [pose], free, np.ones(batch.count), sigma, None))[0]


def view_score(
    state: RigState,
    pose: Pose,
    view: View,
    free: np.ndarray,
    sigma: float,
    inliers: tuple[np.ndarray, ...],
) -> tuple[np.ndarray, np.ndarray]:
    """(F, F) what one view tells about the free parameters, and (F,) whither it pulls them."""
    batch = _Batch([view], len(state.cameras))
    weights = np.concatenate(
        [own[rows] for own, rows in zip(inliers, batch.rows, strict=True)]
    ).astype(float)
    return _reduced(batch.normal(state, [pose], free, weights, sigma, None))[:2]


class _Batch:
    """All observations in rows, so that each camera is projected in one call."""

    def __init__(self, views: Sequence[View], cameras: int) -> None:
        self.views = views
        self.cameras = cameras
        self.points: list[np.ndarray] = []
        self.pixels: list[np.ndarray] = []
        self.known: list[np.ndarray] = []
        self.owner: list[np.ndarray] = []
        self.rows: list[np.ndarray] = []
        for side in range(cameras):
            rows = [np.flatnonzero(np.isfinite(v.pixels[side]).any(axis=1)) for v in views]
            pixels = np.concatenate([v.pixels[side][r] for v, r in zip(views, rows, strict=True)])
            self.points.append(
                np.concatenate([v.points[r] for v, r in zip(views, rows, strict=True)])
            )
            self.known.append(np.isfinite(pixels))
            self.pixels.append(np.nan_to_num(pixels))
            self.owner.append(np.repeat(np.arange(len(views)), [len(r) for r in rows]))
            self.rows.append(np.concatenate(rows))
        self.count = sum(len(rows) for rows in self.rows)
        self.coordinates = np.concatenate(self.known).sum(axis=1)

    def normal(
        self,
        state: RigState,
        poses: Sequence[Pose],
        free: np.ndarray,
        weights: np.ndarray,
        sigma: float,
        prior: Prior | None,
    ) -> _Normal:
        """The normal equations at `state`, with the residuals (count, 2) and the cost."""
        n, m = int(free.sum()), len(poses)
        normal = _Normal(
            np.zeros((n, n)),
            np.zeros(n),
            np.zeros((m, 6, 6)),
            np.zeros((m, 6)),
            np.zeros((m, 6, n)),
            np.zeros((0, 2)),
            0.0,
        )
        rotations = np.array([pose.rotation for pose in poses])
        translations = np.array([pose.translation for pose in poses])
        first = 0
        residuals = []
        for side in range(self.cameras):
            owner = self.owner[side]
            turned = np.einsum('nij,nj->ni', rotations[owner], self.points[side])
            seen = project(state, side, turned + translations[owner])
            known = self.known[side]
            residual = np.where(known, self.pixels[side] - seen.pixels, 0.0)
            residuals.append(residual)
            weight = weights[first : first + len(owner)] / sigma**2
            first += len(owner)
            by_point = seen.by_point * known[:, :, None]
            by_pose = np.concatenate([by_point @ -cross_matrices(turned), by_point], axis=2)
            by_rig = (seen.by_rig[:, :, free] * known[:, :, None]).reshape(2 * len(owner), n)
            weighted = by_rig * np.repeat(weight, 2)[:, None]
            normal.rig += by_rig.T @ weighted
            normal.rig_right += weighted.T @ residual.ravel()
            normal.cost += float(np.sum(weight * np.sum(residual**2, axis=1)))
            for view in range(m):
                first_row, end_row = np.searchsorted(owner, [view, view + 1])
                span = slice(first_row, end_row)
                own = by_pose[span].reshape(-1, 6)
                own_weighted = (by_pose[span] * weight[span, None, None]).reshape(-1, 6)
                normal.pose[view] += own.T @ own_weighted
                normal.pose_right[view] += own_weighted.T @ residual[span].ravel()
                normal.coupling[view] += own_weighted.T @ by_rig[2 * first_row : 2 * end_row]
        for view, one in enumerate(self.views):
            if not one.turns:
                normal.pose[view, :3, :3] += HELD * np.eye(3)
        if prior is not None:
            change = state.minus(prior.state)
            normal.rig += prior.information[np.ix_(free, free)]
            pull = prior.information @ change
            normal.rig_right -= pull[free]
            normal.cost += float(change @ pull)
        normal.residuals = np.concatenate(residuals)
        if not np.isfinite(normal.cost):
            normal.cost = np.inf
        return normal

    def split(
        self, values: np.ndarray, fill: float = np.nan
    ) -> tuple[tuple[np.ndarray, ...], ...]:
        """Rows back to views and cameras."""
        parts: list[list[np.ndarray]] = [[] for _ in self.views]
        first = 0
        for side in range(self.cameras):
            for view, one in enumerate(self.views):
                span = slice(*np.searchsorted(self.owner[side], [view, view + 1]))
                shape = (len(one.points), *values.shape[1:])
                whole = np.full(shape, fill, values.dtype)
                whole[self.rows[side][span]] = values[first : first + len(self.owner[side])][span]
                parts[view].append(whole)
            first += len(self.owner[side])
        return tuple(tuple(part) for part in parts)


def _descend(
    batch: _Batch,
    state: RigState,
    poses: Sequence[Pose],
    free: np.ndarray,
    prior: Prior | None,
    weights: np.ndarray,
    sigma: float,
    converged: float,
) -> tuple[RigState, list[Pose], np.ndarray]:
    damping = 1e-4
    current = list(poses)
    normal = batch.normal(state, current, free, weights, sigma, prior)
    if not np.isfinite(normal.cost):
        raise CalibrationError(
            'the first guess sees no board: a view lies behind the camera or before the '
            'interface; check the board size and the distance given for the interface'
        )
    for _ in range(STEPS):
        reduced, right, gain = _reduced(normal, damping)
        step = np.linalg.lstsq(reduced, right, rcond=None)[0] if len(right) else right
        change = np.zeros(len(free))
        change[free] = step
        pose_step = np.einsum(
            'mij,mj->mi', gain, normal.pose_right - np.einsum('mij,j->mi', normal.coupling, step)
        )
        try:
            trial = state.plus(change)
        except ValueError:
            damping *= 10.0  # outside what an interface or a lens can be
            if damping > 1e12:
                break
            continue
        trial_poses = [
            Pose(exponential(d[:3]) @ pose.rotation, pose.translation + d[3:])
            for pose, d in zip(current, pose_step, strict=True)
        ]
        ahead = batch.normal(trial, trial_poses, free, weights, sigma, prior)
        if ahead.cost < normal.cost:
            decrease = (normal.cost - ahead.cost) / max(normal.cost, 1e-300)
            state, current, normal = trial, trial_poses, ahead
            if decrease < converged or normal.cost < 1e-12 * batch.count:
                break
            damping = max(damping * 0.1, 1e-12)
        else:
            damping *= 10.0
            if damping > 1e12:
                break
    return state, current, normal.residuals


def _reduced(normal: _Normal, damping: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The rig's equations with the poses eliminated, and the poses' inverses."""
    pose = normal.pose.copy()
    diagonal = np.einsum('mii->mi', pose)
    # A hair of stiffness for what a view leaves open, as the turn of a rod about itself.
    pose[:, range(6), range(6)] += damping * diagonal + 1e-12 * np.maximum(diagonal, 1.0)
    gain = np.linalg.inv(pose)
    carried = np.einsum('mij,mjk->mik', gain, normal.coupling)
    rig = normal.rig + damping * np.diag(np.diag(normal.rig))
    reduced = rig - np.einsum('mji,mjk->ik', normal.coupling, carried)
    right = normal.rig_right - np.einsum('mij,mi->j', carried, normal.pose_right)
    return reduced, right, gain


def _inverse(information: np.ndarray, state: RigState, free: np.ndarray) -> np.ndarray:
    """The covariance; parameters that nothing determines make it fail with their names."""
    if not len(information):
        return information
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] < 1e-13:
        worst = np.abs(vectors[:, 0])
        names = np.array(state.names)[free][worst > 0.3 * worst.max()]
        raise CalibrationError(
            f'these views do not determine {", ".join(names)}: add views with other tilts and '
            'distances, or give what is known as a prior'
        )
    inverse = (vectors / values) @ vectors.T
    return inverse * np.outer(scale, scale)


def _robust_sigma(residual: np.ndarray) -> float:
    """From the median length of a 2-D Gaussian residual (Rayleigh)."""
    return float(np.median(np.sqrt(np.sum(residual**2, axis=1)))) / np.sqrt(2.0 * np.log(2.0))


def _least_squares_sigma(residual: np.ndarray, inlier: np.ndarray, surplus: int) -> float:
    if surplus <= 0:
        raise CalibrationError(
            'fewer measurements than unknowns: more views, or boards with more points, are needed'
        )
    return float(np.sqrt(np.sum(residual[inlier] ** 2) / surplus))
