"""ChArUco corners with both of OpenCV's interfaces (functions up to 4.6, classes from 4.7)."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board

FEWEST_CORNERS = 6  # fewer do not tell a pose and its error apart


def find_corners(grey: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    """Indices (N,) and pixels (N, 2) of the ChArUco corners, or None.

    Raises:
        CalibrationError: where the picture is mirrored, or this OpenCV has no ChArUco.
    """
    found = _detect(grey, board)
    if found is None and _detect(np.ascontiguousarray(grey[:, ::-1]), board) is not None:
        raise CalibrationError(
            'the board is mirrored: its markers read only in the flipped picture; switch off the '
            "camera's mirror mode, or turn the board's printed face to the camera"
        )
    return found


def _detect(grey: np.ndarray, board: Board) -> tuple[np.ndarray, np.ndarray] | None:
    aruco: Any = cv2.aruco
    printed = board.aruco()
    if hasattr(aruco, 'CharucoDetector'):
        detector = aruco.CharucoDetector(printed)
        corners, indices, _, _ = detector.detectBoard(grey)
    else:
        markers, marker_ids, _ = aruco.detectMarkers(grey, board.aruco_dictionary())
        if marker_ids is None or len(marker_ids) == 0:
            return None
        _, corners, indices = aruco.interpolateCornersCharuco(markers, marker_ids, grey, printed)
    if indices is None or len(indices) < FEWEST_CORNERS:
        return None
    order = np.argsort(indices.ravel())
    return indices.ravel()[order].astype(int), corners.reshape(-1, 2)[order].astype(float)
