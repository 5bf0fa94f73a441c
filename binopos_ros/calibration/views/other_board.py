"""A board of another size than the one given: told before it makes a calibration of nonsense."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import CHESSBOARD, Board
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.calibration.views.pictures import PicturePair

SMALLEST = (3, 3)
ASKED = 3  # pictures


def refuse_other_board(
    pictures: Sequence[PicturePair], pairs: Sequence[BoardPair], board: Board, fewest: int
) -> None:
    """Say so where the pictures hold another chessboard than the one given.

    Args:
        pictures: by name; pairs: what was found in them.
        board: the one given.
        fewest: complete pairs without which there is no calibration.

    Raises:
        CalibrationError: all pictures asked hold a larger one, of which the one given is a part,
            or the one given is hardly anywhere.
    """
    blank = [pair.name for pair in pairs if not pair.complete]
    whole = [pair.name for pair in pairs if pair.complete]
    by_name = {one.name: one for one in pictures}
    asked = [*blank, *whole][:ASKED]
    other, holding = largest_board([by_name[name].left() for name in asked], board)
    if other is None:
        return
    contains = other.columns >= board.columns and other.rows >= board.rows
    if (contains and holding == len(asked)) or len(whole) < fewest:
        raise CalibrationError(
            f'{asked[0]}: no {board}, but one of {other.columns}x{other.rows} is there: give '
            'the board its right size (a chessboard counts its inner corners)'
        )


def largest_board(images: Sequence[np.ndarray], board: Board) -> tuple[Board | None, int]:
    """The largest chessboard, other than the one given, that most of the pictures share.

    A finder that is asked for too small a board takes part of a larger one for it, another part
    in each picture; one that may grow takes things beside the board for corners. So the sizes
    that any picture suggests are tried on all.

    Returns:
        It, or None, and how many pictures hold it.
    """
    if board.kind != CHESSBOARD:
        return None, 0
    opencv: Any = cv2
    sizes = set()
    for image in images:
        for flags in (cv2.CALIB_CB_LARGER, cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE):
            found, _, meta = opencv.findChessboardCornersSBWithMeta(image, SMALLEST, flags)
            if found:
                # Rows and columns as they happened to be seen; in the order of the board given.
                shorter, longer = sorted(meta.shape[:2])
                wide = board.columns >= board.rows
                sizes.add((longer, shorter) if wide else (shorter, longer))
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    holding = {
        size: sum(cv2.findChessboardCorners(image, size, flags=flags)[0] for image in images)
        for size in sizes - {(board.columns, board.rows)}
    }
    if not any(holding.values()):
        return None, 0
    most = max(holding, key=lambda size: (holding[size], size[0] * size[1]))
    return Board(CHESSBOARD, *most, board.square), holding[most]
