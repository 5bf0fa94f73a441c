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

    def print(self, texels: int) -> tuple[np.ndarray, np.ndarray]:
        """The board's print, without a margin.

        Args:
            texels: per square.

        Returns:
            (H, W) the share of each texel that is inked; (2,) the board coordinates of the upper
            left corner (m).
        """
        if self.kind in (CHESSBOARD, CHARUCO):
            # The first inner corner, the origin, lies one square inside the pattern.
            ink = self._squares(texels) if self.kind == CHESSBOARD else self._markers(texels)
            return ink, np.full(2, -self.square)
        return self._discs(texels), np.full(2, -0.5 * self.square)

    def aruco(self) -> Any:
        """A ChArUco board as OpenCV's object: of a class from 4.7 on, of a function before."""
        aruco: Any = cv2.aruco
        dictionary = self.aruco_dictionary()
        if hasattr(aruco, 'CharucoDetector'):
            size = (self.columns, self.rows)
            printed = aruco.CharucoBoard(size, self.square, self.marker, dictionary)
            printed.setLegacyPattern(self.legacy)
            return printed
        return aruco.CharucoBoard_create(
            self.columns, self.rows, self.square, self.marker, dictionary
        )

    def aruco_dictionary(self) -> Any:
        """A ChArUco board's dictionary as OpenCV's object."""
        aruco: Any = cv2.aruco
        return aruco.getPredefinedDictionary(getattr(aruco, self.dictionary))

    def _squares(self, texels: int) -> np.ndarray:
        row, column = np.mgrid[: self.rows + 1, : self.columns + 1]
        black = np.where((row + column) % 2 == 0, 1.0, 0.0)
        return np.repeat(np.repeat(black, texels, axis=0), texels, axis=1)

    def _markers(self, texels: int) -> np.ndarray:
        size = (self.columns * texels, self.rows * texels)
        printed = self.aruco()
        draw = printed.generateImage if hasattr(printed, 'generateImage') else printed.draw
        return np.where(np.asarray(draw(size)) > 127, 0.0, 1.0)

    def _discs(self, texels: int) -> np.ndarray:
        """Circles whose edge texels are grey by the share that is covered."""
        points = self.points[:, :2] / self.square * texels + texels / 2
        width, height = np.ceil(points.max(axis=0) + texels / 2).astype(int)
        radius = (0.45 if self.kind == ASYMMETRIC_CIRCLES else 0.3) * texels
        y, x = np.mgrid[:height, :width] + 0.5
        nearest = np.full((height, width), np.inf)
        for u, v in points:
            nearest = np.minimum(nearest, np.hypot(x - u, y - v))
        return np.clip(0.5 + radius - nearest, 0, 1)

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
