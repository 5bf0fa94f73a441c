"""Both cameras and their mutual pose from views of a board: `binopos calibrate stereo`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.held_out import HeldOut, cross_validate
from binopos_ros.calibration.adjustment.noise import widened
from binopos_ros.calibration.adjustment.shape import (
    FLAT,
    BoardShape,
    bent_board,
    with_uncertain_shape,
)
from binopos_ros.calibration.adjustment.start import straight_poses
from binopos_ros.calibration.cameras.camera import CameraFit, calibrate_camera, check_determined
from binopos_ros.calibration.cameras.given import GIVEN, GivenCameras
from binopos_ros.calibration.cameras.lens import AUTO, LensChoice, lens_prior, one_to_one
from binopos_ros.calibration.cameras.rigidity import FEWEST_PAIRS, consensus, explain
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import upright_like
from binopos_ros.calibration.views.pairs import BoardPair, Dropped, drop_blurred, repeats, select
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState
from binopos_ros.sides import SIDES

MOST_VIEWS = 40

Sizes = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True)
class StereoCalibration:
    """What `calibrate_stereo` found.

    Attributes:
        adjustment: joint; its covariance is that of all parameters together.
        board: what was seen.
        views: those used.
        dropped: those not used, with reasons.
        lenses: each camera's lens model, and why.
        held_out: cross-validation of the chosen model.
        shape: of the board.
    """

    adjustment: Adjustment
    board: Board
    views: tuple[View, ...]
    dropped: tuple[Dropped, ...]
    lenses: tuple[LensChoice, LensChoice]
    held_out: HeldOut
    shape: BoardShape

    @property
    def state(self) -> RigState:
        """The rig."""
        return self.adjustment.state


def calibrate_stereo(
    pairs: Sequence[BoardPair],
    board: Board,
    sizes: Sizes,
    most_views: int = MOST_VIEWS,
    lens: str = AUTO,
    given: GivenCameras | None = None,
) -> StereoCalibration:
    """Calibrate a stereo rig in air.

    Args:
        pairs: what both cameras found, picture pair by picture pair; what one alone has found
            counts for its lens.
        board: the board.
        sizes: width and height of the left and the right pictures (px).
        most_views: views beyond this are left out, the least useful first.
        lens: one of `lens.LENSES`.
        given: the cameras where they are calibrated already; None estimates them.

    Raises:
        CalibrationError: too few views, views that do not belong to one rigid rig, swapped or
            mirrored cameras, a board that never tilts.
    """
    usable, alone, dropped = _usable(pairs, board)
    usable, gone = _worth_using(usable, board, sizes, most_views)
    alone, gone_alone = _worth_using(alone, board, sizes, most_views)
    dropped += [*gone, *gone_alone]
    views = [pair.view(board) for pair in (*usable, *alone)]

    reasons: dict[str, str] = {}
    if given is None:
        left, right = (
            calibrate_camera(views, side, sizes[side], lens=lens) for side in (LEFT, RIGHT)
        )
        check_determined(left, LEFT)
        check_determined(right, RIGHT)
        cameras = left.adjustment.state.cameras[0], right.adjustment.state.cameras[0]
        lenses = left.lens, right.lens
        reasons = _outlying((left, right))
    else:
        given.refuse_other_size(sizes)
        cameras, lenses = given.cameras, (GIVEN, GIVEN)
    start, disagreeing = consensus(cameras, views, board)
    reasons |= disagreeing
    dropped += [Dropped(view.name, reasons[view.name]) for view in views if view.name in reasons]
    views = [view for view in views if view.name not in reasons]
    _enough(views, dropped)

    if given is None:
        free, prior = np.ones(len(start.names), bool), lens_prior(start)
    else:
        free, prior = given.unknowns(start)
    fit, views, worse = _joint(start, views, free, prior)
    dropped += worse
    _enough(views, dropped)
    if given is None:
        fit, prior = one_to_one(fit, views, prior)
    held_out = cross_validate(fit, views, prior)
    bent = bent_board(fit, views, prior, held_out)
    # A rational lens's prior tells next to nothing: it only keeps the terms from running away.
    told = prior if given is not None else None
    if bent is None:
        fit, shape = widened(fit, views, told), FLAT
    else:
        (better, held_out), views = bent, list(bent[0].views)
        fit, shape = with_uncertain_shape(widened(better.fit, views, told), better)
    return StereoCalibration(
        fit,
        board,
        tuple(views),
        tuple(dropped),
        lenses,
        held_out,
        shape,
    )


def _usable(
    pairs: Sequence[BoardPair], board: Board
) -> tuple[list[BoardPair], list[BoardPair], list[Dropped]]:
    """Pairs in which both cameras found the board, in which one did, and the others."""
    usable, alone, dropped = [], [], []
    for pair in pairs:
        if pair.left is None and pair.right is None:
            dropped.append(Dropped(pair.name, f'no {board} found in either picture'))
        elif pair.left is None or pair.right is None:
            alone.append(pair)
        else:
            usable.append(replace(pair, right=upright_like(pair.right, pair.left, board)))
    if len(usable) < FEWEST_PAIRS:
        raise CalibrationError(
            f'the {board} was found by both cameras in {len(usable)} of {len(pairs)} pairs, at '
            f'least {FEWEST_PAIRS} are needed: check the board given (a chessboard counts its '
            'inner corners), and that all of it is in both pictures'
        )
    return usable, alone, dropped


def _worth_using(
    pairs: Sequence[BoardPair], board: Board, sizes: Sizes, most_views: int
) -> tuple[list[BoardPair], list[Dropped]]:
    """Without what is blurred, shown again, or beyond the most views."""
    sharp, blurred = drop_blurred(pairs)
    again = repeats([pair.view(board) for pair in sharp])
    once = [pair for i, pair in enumerate(sharp) if i not in again]
    chosen, spare = select(once, board, sizes, most_views)
    return chosen, [*blurred, *again.values(), *spare]


def _outlying(single: Sequence[CameraFit]) -> dict[str, str]:
    reasons: dict[str, str] = {}
    for name, fit in zip(SIDES, single, strict=True):
        for view, reason in fit.outlying.items():
            reasons.setdefault(view, f'{name} picture: {reason}')
    return reasons


def seen_by_both(views: Sequence[View]) -> int:
    """How many of the views both cameras have."""
    return sum(all(np.isfinite(side).any() for side in view.pixels) for view in views)


def _enough(views: Sequence[View], dropped: Sequence[Dropped]) -> None:
    good = seen_by_both(views)
    if good < FEWEST_PAIRS:
        reason = dropped[-1] if dropped else 'no reason'
        raise CalibrationError(
            f'{good} good pairs are left of {len(views) + len(dropped)}, at least '
            f'{FEWEST_PAIRS} are needed; the last one left out: {reason}'
        )


def _joint(
    start: RigState, views: Sequence[View], free: np.ndarray, prior: Prior
) -> tuple[Adjustment, list[View], list[Dropped]]:
    """The joint adjustment, again without the pairs that only now prove bad."""
    fit = adjust(start, straight_poses(start, views), views, free, prior)
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
    if seen_by_both(kept) < FEWEST_PAIRS:
        return fit, kept, dropped
    return adjust(fit.state, poses, kept, free, prior), kept, dropped
