"""Both cameras and their mutual pose from views of a board: `binopos calibrate stereo`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adequacy import Adequacy, adequacy, better_by
from binopos_ros.calibration.adjustment.adjust import Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.noise import widened
from binopos_ros.calibration.adjustment.start import guess_pose
from binopos_ros.calibration.cameras.camera import (
    BROWN_TERMS,
    RATIONAL_TERMS,
    CameraFit,
    calibrate_camera,
    check_determined,
)
from binopos_ros.calibration.cameras.rigidity import FEWEST_PAIRS, consensus, explain
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import upright_like
from binopos_ros.calibration.views.pairs import BoardPair, Dropped, drop_blurred, select
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import LEFT, RIGHT, Camera, RigState
from binopos_ros.sides import SIDES

MOST_VIEWS = 40
FOLDS = 5
RATIONAL_SPREAD = 3.0  # standard deviation of radial terms beforehand
BETTER = 2.0  # standard errors by which a larger lens model must win on held-out views

Sizes = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True)
class HeldOut:
    """Cross-validation: each view judged by a calibration that has not seen it.

    Attributes:
        rms: of the reprojection with the board's pose fitted to both pictures (px).
        transfer: of the right picture's points with the pose fitted to the left alone (px).
        squares: (V,) each view's mean square (px^2); nan where a view never took part.
    """

    rms: float
    transfer: float
    squares: np.ndarray


@dataclass(frozen=True)
class StereoCalibration:
    """What `calibrate_stereo` found.

    Attributes:
        adjustment: joint; its covariance is that of all parameters together.
        board: what was seen.
        views: those used.
        dropped: those not used, with reasons.
        lenses: the adequacy test of each camera's five-term lens.
        held_out: cross-validation of the chosen model.
        lens_choice: in words, which lens model and why.
    """

    adjustment: Adjustment
    board: Board
    views: tuple[View, ...]
    dropped: tuple[Dropped, ...]
    lenses: tuple[Adequacy, Adequacy]
    held_out: HeldOut
    lens_choice: str

    @property
    def state(self) -> RigState:
        """The rig."""
        return self.adjustment.state


def calibrate_stereo(
    pairs: Sequence[BoardPair], board: Board, sizes: Sizes, most_views: int = MOST_VIEWS
) -> StereoCalibration:
    """Calibrate a stereo rig in air.

    Args:
        pairs: what both cameras found, picture pair by picture pair.
        board: the board.
        sizes: width and height of the left and the right pictures (px).
        most_views: views beyond this are left out, the least useful first.

    Raises:
        CalibrationError: too few views, views that do not belong to one rigid rig, swapped or
            mirrored cameras, a board that never tilts.
    """
    usable, dropped = _usable(pairs, board)
    usable, blurred = drop_blurred(usable)
    usable, spare = select(usable, board, sizes, most_views)
    dropped += blurred + spare
    views = [pair.view(board) for pair in usable]

    single = [calibrate_camera(views, side, sizes[side]) for side in (LEFT, RIGHT)]
    for side, camera_fit in enumerate(single):
        check_determined(camera_fit, side)
    cameras = (
        single[LEFT].adjustment.state.cameras[0],
        single[RIGHT].adjustment.state.cameras[0],
    )
    start, disagreeing = consensus(cameras, views, board)
    reasons = _outlying(single) | disagreeing
    dropped += [Dropped(view.name, reasons[view.name]) for view in views if view.name in reasons]
    views = [view for view in views if view.name not in reasons]
    _enough(views, dropped)

    fit, views, worse = _joint(start, views)
    dropped += worse
    _enough(views, dropped)
    lenses = (adequacy(fit, views, LEFT), adequacy(fit, views, RIGHT))
    held_out = cross_validate(fit, views)
    fit, held_out, choice = _choose_lens(fit, views, lenses, held_out)
    # A rational lens's prior tells next to nothing: it only keeps the terms from running away.
    fit = widened(fit, views)
    return StereoCalibration(fit, board, tuple(views), tuple(dropped), lenses, held_out, choice)


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
        rig = adjust(
            fit.state, [fit.poses[i] for i in rest], [views[i] for i in rest], fit.free, prior
        ).state
        test = [views[i] for i in out]
        judged = adjust(rig, [fit.poses[i] for i in out], test, none, robust=False, sigma=1.0)
        for i, residuals in zip(out, judged.residuals, strict=True):
            both = np.concatenate([r[np.isfinite(r).all(axis=1)] for r in residuals])
            squares[i] = np.mean(np.sum(both**2, axis=1))
            lengths.append(np.sum(both**2, axis=1))
        left_only = [
            (i, View(v.name, v.points, v.pixels[:1]))
            for i, v in zip(out, test, strict=True)
            if all(np.isfinite(p).all(axis=1).sum() >= 4 for p in v.pixels)
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
    left = RigState(rig.cameras[:1])
    none = np.zeros(len(left.names), bool)
    posed = adjust(left, start, [view for _, view in left_only], none, robust=False, sigma=1.0)
    squares = []
    for (i, _), pose in zip(left_only, posed.poses, strict=True):
        local = pose.apply(views[i].points) @ rig.rotation.T + rig.translation
        error = views[i].pixels[RIGHT] - rig.cameras[RIGHT].pinhole().project(local)
        error = error[np.isfinite(error).all(axis=1)]
        squares.append(np.sum(error**2, axis=1))
    return squares


def _usable(pairs: Sequence[BoardPair], board: Board) -> tuple[list[BoardPair], list[Dropped]]:
    usable, dropped = [], []
    for pair in pairs:
        if pair.left is None and pair.right is None:
            dropped.append(Dropped(pair.name, f'no {board} found in either picture'))
        elif pair.left is None or pair.right is None:
            missing = 'left' if pair.left is None else 'right'
            dropped.append(Dropped(pair.name, f'no {board} found in the {missing} picture'))
        else:
            usable.append(replace(pair, right=upright_like(pair.right, pair.left, board)))
    if len(usable) < FEWEST_PAIRS:
        raise CalibrationError(
            f'the {board} was found by both cameras in {len(usable)} of {len(pairs)} pairs, at '
            f'least {FEWEST_PAIRS} are needed: check the board given (a chessboard counts its '
            'inner corners), and that all of it is in both pictures'
        )
    return usable, dropped


def _outlying(single: Sequence[CameraFit]) -> dict[str, str]:
    reasons: dict[str, str] = {}
    for name, fit in zip(SIDES, single, strict=True):
        for view, reason in fit.outlying.items():
            reasons.setdefault(view, f'{name} picture: {reason}')
    return reasons


def _enough(views: Sequence[View], dropped: Sequence[Dropped]) -> None:
    if len(views) < FEWEST_PAIRS:
        reason = dropped[-1] if dropped else 'no reason'
        raise CalibrationError(
            f'{len(views)} good pairs are left of {len(views) + len(dropped)}, at least '
            f'{FEWEST_PAIRS} are needed; the last one left out: {reason}'
        )


def _joint(start: RigState, views: Sequence[View]) -> tuple[Adjustment, list[View], list[Dropped]]:
    """The joint adjustment, again without the pairs that only now prove bad."""
    free = np.ones(len(start.names), bool)
    fit = adjust(start, _poses(start.cameras[0], views), views, free)
    rms = np.array([fit.rms(view=i) for i in range(len(views))])
    limit = max(2.5 * float(np.median(rms)), 0.15)
    bad = rms > limit
    if not bad.any():
        return fit, list(views), []
    dropped = [
        Dropped(
            view.name,
            f'the pair misses the rig by {value:.2f} px, the others by {np.median(rms):.2f} px: '
            f'{explain(fit.state, view)}',
        )
        for view, value in zip(views, rms, strict=True)
        if value > limit
    ]
    kept = [view for view, one in zip(views, bad, strict=True) if not one]
    poses = [pose for pose, one in zip(fit.poses, bad, strict=True) if not one]
    if len(kept) < FEWEST_PAIRS:
        return fit, kept, dropped
    return adjust(fit.state, poses, kept, free), kept, dropped


def _poses(left: Camera, views: Sequence[View]) -> list[Pose]:
    poses = []
    for view in views:
        pose = guess_pose(left, view.points, view.pixels[LEFT])
        if pose is None:
            raise CalibrationError(f'{view.name}: the board gives no pose in the left picture')
        poses.append(pose)
    return poses


def _choose_lens(
    fit: Adjustment,
    views: Sequence[View],
    lenses: tuple[Adequacy, Adequacy],
    held_out: HeldOut,
) -> tuple[Adjustment, HeldOut, str]:
    """Try eight terms where five are not adequate; keep them if they win on held-out views."""
    worst = min(lens.probability for lens in lenses)
    if all(lens.adequate for lens in lenses):
        return fit, held_out, f'five terms are adequate (p = {worst:.2g} of chance residuals)'
    cameras = tuple(
        replace(camera, lens=np.concatenate([camera.lens, np.zeros(RATIONAL_TERMS - BROWN_TERMS)]))
        if not lens.adequate
        else camera
        for camera, lens in zip(fit.state.cameras, lenses, strict=True)
    )
    start = replace(fit.state, cameras=cameras)
    lead = f'five terms leave systematic residuals (p = {worst:.2g})'
    try:
        # The six radial terms trade off against each other; this keeps them from running away.
        lens = [name.split('.')[-1][0] == 'k' for name in start.names]
        prior = Prior(start, np.diag(np.array(lens) / RATIONAL_SPREAD**2))
        larger = adjust(start, fit.poses, views, np.ones(len(lens), bool), prior)
        judged = cross_validate(larger, views, prior)
    except CalibrationError:
        return fit, held_out, f'{lead}, but these views do not determine a rational lens'
    score = better_by(held_out.squares, judged.squares)
    change = f'held-out RMS {held_out.rms:.3f} -> {judged.rms:.3f} px, {score:.1f} standard errors'
    if score < BETTER:
        return fit, held_out, f'{lead}, but a rational lens is no better ({change})'
    return larger, judged, f'{lead}: rational lens ({change})'
