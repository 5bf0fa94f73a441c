"""Do the two cameras' views belong to one rigid rig? Swapped, mirrored, moved and foreign boards.

Each pair gives the right camera's pose against the left one by itself. In a rigid rig these agree;
how they disagree tells what went wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.start import guess_pose
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import Camera, RigState, logarithm
from binopos_ros.sides import SIDES

LARGEST_TURN = 2.0  # degrees between a pair's relative pose and the rig's
LARGEST_SHIFT = 0.05  # of the baseline or of the board's distance, whichever is larger
SAME_SCALE = 0.03
MOST = 0.7  # of the pairs must agree for an explanation to hold
FEWEST_PAIRS = 4


@dataclass(frozen=True)
class RelativePose:
    """One pair's board in both cameras, and right_from_left as it gives it."""

    left: Pose
    right: Pose

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3)."""
        return self.right.rotation @ self.left.rotation.T

    @property
    def translation(self) -> np.ndarray:
        """(3,) m."""
        return self.right.translation - self.rotation @ self.left.translation


def relative_poses(
    cameras: tuple[Camera, Camera], views: Sequence[View]
) -> list[RelativePose | None]:
    """Each view's relative pose; None where a camera does not see the board."""
    poses: list[RelativePose | None] = []
    for view in views:
        sides = [
            guess_pose(camera, view.points, pixels)
            for camera, pixels in zip(cameras, view.pixels, strict=True)
        ]
        left, right = sides
        poses.append(RelativePose(left, right) if left and right else None)
    return poses


def consensus(
    cameras: tuple[Camera, Camera], views: Sequence[View], board: Board
) -> tuple[RigState, dict[str, str]]:
    """The rig that most pairs agree on, and why the others do not.

    Raises:
        CalibrationError: too few complete pairs, or most pairs disagree: unsynchronised or
            wrongly paired pictures, a mirrored camera, swapped cameras.
    """
    poses = relative_poses(cameras, views)
    complete = [i for i, pose in enumerate(poses) if pose is not None]
    if len(complete) < FEWEST_PAIRS:
        raise CalibrationError(
            f'both cameras see the board together in {len(complete)} pairs: at least '
            f'{FEWEST_PAIRS} are needed; keep the board in the part that both see'
        )
    pairs = {i: pose for i, pose in enumerate(poses) if pose is not None}
    rotation, translation, agreeing = _largest_agreement(pairs)
    if len(agreeing) < max(FEWEST_PAIRS - 1, 0.5 * len(complete)):
        raise CalibrationError(_why_no_agreement(cameras, views, board, len(agreeing), pairs))
    _refuse_swapped(rotation, translation)
    reasons = {
        views[i].name: _why(pose, rotation, translation)
        for i, pose in pairs.items()
        if i not in agreeing
    }
    return RigState(cameras, rotation, translation), reasons


def _largest_agreement(
    pairs: dict[int, RelativePose],
) -> tuple[np.ndarray, np.ndarray, list[int]]:
    best: list[int] = []
    for candidate in pairs.values():
        agreeing = [
            i
            for i, pose in pairs.items()
            if _agrees(pose, candidate.rotation, candidate.translation)
        ]
        if len(agreeing) > len(best):
            best = agreeing
    translation = np.median([pairs[i].translation for i in best], axis=0)
    total = np.sum([pairs[i].rotation for i in best], axis=0)
    u, _, vt = np.linalg.svd(total)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    best = [i for i, pose in pairs.items() if _agrees(pose, rotation, translation)]
    return rotation, translation, best


def _agrees(pose: RelativePose, rotation: np.ndarray, translation: np.ndarray) -> bool:
    turn = np.degrees(np.linalg.norm(logarithm(pose.rotation @ rotation.T)))
    reach = max(np.linalg.norm(translation), np.linalg.norm(pose.left.translation))
    # A single view's turn and shift compensate each other, so the shift is judged at the board.
    seen = pose.right.translation - rotation @ pose.left.translation - translation
    return bool(turn < LARGEST_TURN and np.linalg.norm(seen) < LARGEST_SHIFT * reach)


def explain(state: RigState, view: View) -> str:
    """Why a pair does not fit a rig: another board, or something moved."""
    (pose,) = relative_poses((state.cameras[0], state.cameras[1]), [view])
    if pose is None:
        return 'a camera sees too little of the board'
    return _why(pose, state.rotation, state.translation)


def _why(pose: RelativePose, rotation: np.ndarray, translation: np.ndarray) -> str:
    turn = np.degrees(np.linalg.norm(logarithm(pose.rotation @ rotation.T)))
    own = pose.right.translation - rotation @ pose.left.translation
    scale = float(np.linalg.norm(own) / np.linalg.norm(translation))
    cosine = float(own @ translation / np.linalg.norm(own) / np.linalg.norm(translation))
    if turn < LARGEST_TURN and cosine > 0.99 and abs(scale - 1.0) > SAME_SCALE:
        return (
            f'a board of another size: its squares seem {1.0 / scale:.2f} times as large as the '
            'board given; use one board for all pictures'
        )
    return (
        f'left and right disagree with the other pairs by {turn:.1f} degrees and '
        f'{1000 * np.linalg.norm(own - translation):.0f} mm: the board moved between the two '
        'pictures, or they do not belong together'
    )


def _refuse_swapped(rotation: np.ndarray, translation: np.ndarray) -> None:
    position = -rotation.T @ translation
    if position[0] < 0 and abs(position[0]) > abs(position[1]):
        raise CalibrationError(
            f"left and right are swapped: the 'right' camera stands {-1000 * position[0]:.0f} mm "
            "to the left of the 'left' one; swap the two sources, or switch off the mirror mode "
            'if both cameras have it on'
        )


def _why_no_agreement(
    cameras: tuple[Camera, Camera],
    views: Sequence[View],
    board: Board,
    agreeing: int,
    pairs: dict[int, RelativePose],
) -> str:
    lead = f'only {agreeing} of {len(pairs)} pairs agree on one rig'
    for side, name in enumerate(SIDES):
        flipped = [_flipped(view, side, cameras[side].size, board) for view in views]
        mirrored = list(cameras)
        size = cameras[side].size
        old = cameras[side]
        mirrored[side] = replace(
            old, centre=np.array([size[0] - 1 - old.centre[0], old.centre[1]]), skew=-old.skew
        )
        poses = relative_poses((mirrored[0], mirrored[1]), flipped)
        found = {i: pose for i, pose in enumerate(poses) if pose is not None}
        if not found:
            continue
        rotation, translation, good = _largest_agreement(found)
        # Mirroring the other camera instead gives a rig too, but with left and right swapped.
        if len(good) > MOST * len(found) and -(rotation.T @ translation)[0] > 0:
            return (
                f'{lead}, but {len(good)} do with the {name} pictures mirrored: switch off the '
                f"{name} camera's mirror mode"
            )
    for shift in (1, -1, 2, -2):
        moved = _shifted(views, shift)
        poses = relative_poses(cameras, moved)
        found = {i: pose for i, pose in enumerate(poses) if pose is not None}
        if len(found) < FEWEST_PAIRS:
            continue
        good = _largest_agreement(found)[2]
        if len(good) > MOST * len(found):
            return (
                f'{lead}, but {len(good)} do when each left picture is paired with the right one '
                f'{shift:+d} further on: the two lists are shifted'
            )
    return (
        f'{lead}: the pictures of a pair were not taken at the same time, or a camera moved; hold '
        'the board still for each pair, or synchronise the cameras'
    )


def _flipped(view: View, side: int, size: tuple[int, int], board: Board) -> View:
    columns, rows = board.shape
    pixels = list(view.pixels)
    grid = pixels[side].reshape(rows, columns, 2)[:, ::-1].copy()
    grid[..., 0] = size[0] - 1 - grid[..., 0]
    pixels[side] = grid.reshape(-1, 2)
    turned = View(view.name, view.points, tuple(pixels))
    other = pixels[1 - side].reshape(rows, columns, 2)
    own_way = grid[-1, -1] - grid[0, 0]
    if own_way @ (other[-1, -1] - other[0, 0]) < 0:
        pixels[side] = grid[::-1, ::-1].reshape(-1, 2)
        turned = View(view.name, view.points, tuple(pixels))
    return turned


def _shifted(views: Sequence[View], shift: int) -> list[View]:
    return [
        View(views[i].name, views[i].points, (views[i].pixels[0], views[i + shift].pixels[1]))
        for i in range(len(views))
        if 0 <= i + shift < len(views)
    ]
