"""First guesses: Zhang's closed form for a camera, planar poses for boards.

Z. Zhang, A Flexible New Technique for Camera Calibration, IEEE PAMI 22, 2000. OpenCV's
implementation gives the focal length from the views' homographies; lens and centre start at zero
and the middle, and the adjustment does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from binopos_ros.calibration.adjust import View
from binopos_ros.calibration.projection import Pose
from binopos_ros.calibration.state import Camera

FEWEST_POINTS = 4


def guess_camera(views: Sequence[View], side: int, size: tuple[int, int], terms: int) -> Camera:
    """A camera without distortion, good enough to start from.

    Args:
        views: of planar boards (z = 0 in the board frame).
        side: whose pixels.
        size: image width and height (px).
        terms: how many distortion terms the camera will have.
    """
    points, pixels = [], []
    for view in views:
        seen = np.isfinite(view.pixels[side]).all(axis=1)
        if seen.sum() >= FEWEST_POINTS:
            points.append(view.points[seen].astype(np.float32))
            pixels.append(view.pixels[side][seen].astype(np.float32).reshape(-1, 1, 2))
    width, height = size
    focal = float('nan')
    if points:
        matrix = cv2.initCameraMatrix2D(points, pixels, size, aspectRatio=1.0)
        focal = float(matrix[0, 0])
    # Views that hardly tilt give anything at all; fields of view lie between 10 and 150 degrees.
    if not np.isfinite(focal) or not 0.13 * width < focal < 6.0 * width:
        focal = float(width)
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    return Camera(np.array([focal, focal]), centre, np.zeros(terms), size)


def guess_pose(camera: Camera, points: np.ndarray, pixels: np.ndarray) -> Pose | None:
    """The board's pose in the camera frame from one straight view, or None if there is none.

    Args:
        points: (N, 3) board frame (m); pixels: (N, 2), nan where not seen.
    """
    seen = np.isfinite(pixels).all(axis=1)
    if seen.sum() < FEWEST_POINTS:
        return None
    planar = np.ptp(points[seen][:, 2]) < 1e-12
    method = cv2.SOLVEPNP_IPPE if planar else cv2.SOLVEPNP_ITERATIVE
    origin = points[seen].mean(axis=0)
    found, rotation, translation = cv2.solvePnP(
        points[seen] - origin, pixels[seen], camera.matrix, camera.lens, flags=method
    )
    if not found or not np.isfinite(translation).all() or translation[2, 0] <= 0:
        return None
    matrix = np.asarray(cv2.Rodrigues(rotation)[0])
    return Pose(matrix, translation.ravel() - matrix @ origin)
