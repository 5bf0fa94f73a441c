"""Calibration boards: what is printed on them, and where their points lie.

The board frame has its origin in the first point, x along a row, y along a column, z into the
board (away from a camera that looks at its face), in metres.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError

CHESSBOARD = 'chessboard'
CHARUCO = 'charuco'
CIRCLES = 'circles'
ASYMMETRIC_CIRCLES = 'asymmetric-circles'
KINDS = (CHESSBOARD, CHARUCO, CIRCLES, ASYMMETRIC_CIRCLES)


@dataclass(frozen=True)
class Board:
    """A planar board.

    Args:
        kind: one of `KINDS`.
        columns, rows: points per row and per column. A chessboard counts its inner corners, a
            ChArUco board its squares (both as OpenCV does), a circle grid its circles.
        square: the side of a square (m); for circle grids the distance of two neighbours in a
            row, for asymmetric ones half of it, the diagonal pitch's projection (as OpenCV).
        marker: the side of a ChArUco marker (m).
        dictionary: the name of a ChArUco board's dictionary, as 'DICT_5X5_100'.
        legacy: ChArUco boards printed with OpenCV before 4.6 with an even number of rows start
            with a marker instead of a black square.
    """

    kind: str
    columns: int
    rows: int
    square: float
    marker: float = 0.0
    dictionary: str = 'DICT_4X4_50'
    legacy: bool = False

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise CalibrationError(f'board kind {self.kind!r}: choose one of {", ".join(KINDS)}')
        if self.columns < 3 or self.rows < 3:
            raise CalibrationError(
                f'a board of {self.columns}x{self.rows} is too small: at least 3x3 points'
            )
        if not (np.isfinite(self.square) and self.square > 0):
            raise CalibrationError(
                f'board square {self.square} m: give the printed side in metres, as 0.025'
            )
        if self.square >= 1.0:
            raise CalibrationError(
                f'board square {self.square} m: a metre or more; millimetres were given? '
                f'write {self.square / 1000:g}'
            )
        if self.kind == CHARUCO:
            if not 0 < self.marker < self.square:
                raise CalibrationError(
                    f'ChArUco marker of {self.marker} m in squares of {self.square} m: give the '
                    "marker's side in metres, smaller than the square"
                )
            aruco: Any = getattr(cv2, 'aruco', None)
            if not (hasattr(aruco, 'CharucoDetector') or hasattr(aruco, 'CharucoBoard_create')):
                raise CalibrationError(
                    f'this OpenCV ({cv2.__version__}) has no ChArUco: install '
                    'opencv-contrib-python-headless or any OpenCV from 4.7 on'
                )
            if not hasattr(aruco, self.dictionary):
                raise CalibrationError(
                    f'ChArUco dictionary {self.dictionary!r} is unknown: as in cv2.aruco, for '
                    'instance DICT_5X5_100'
                )

    @property
    def shape(self) -> tuple[int, int]:
        """Points per row and per column."""
        if self.kind == CHARUCO:
            return self.columns - 1, self.rows - 1
        return self.columns, self.rows

    @property
    def points(self) -> np.ndarray:
        """(N, 3) the points in the board frame (m), row by row."""
        columns, rows = self.shape
        row, column = np.divmod(np.arange(columns * rows), columns)
        if self.kind == ASYMMETRIC_CIRCLES:
            column = 2 * column + row % 2
        points = np.zeros((columns * rows, 3))
        points[:, 0] = column * self.square
        points[:, 1] = row * self.square
        return points

    @property
    def extent(self) -> float:
        """The largest distance between two points (m)."""
        points = self.points
        return float(np.linalg.norm(points.max(axis=0) - points.min(axis=0)))

    @property
    def turns_onto_itself(self) -> bool:
        """Whether the board looks the same when turned by 180 degrees."""
        columns, rows = self.shape
        if self.kind == CHESSBOARD:
            return (columns + rows) % 2 == 0
        if self.kind == ASYMMETRIC_CIRCLES:
            return rows % 2 == 0
        return self.kind == CIRCLES

    def __str__(self) -> str:
        return f'{self.columns}x{self.rows} {self.kind} of {1000 * self.square:g} mm'


def parse_size(text: str) -> tuple[int, int]:
    """'9x6' -> (9, 6).

    Raises:
        CalibrationError: where the text is not two whole numbers with an x in between.
    """
    match = re.fullmatch(r'\s*(\d{1,3})\s*[xX×]\s*(\d{1,3})\s*', text)
    if match is None:
        raise CalibrationError(f'board size {text!r}: write columns x rows, as 9x6')
    return int(match[1]), int(match[2])
