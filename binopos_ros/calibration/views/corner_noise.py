"""The corners' own noise: what no camera, lens or shape of the board explains.

However lens and board bend a view, its corners lie on a smooth image of a regular grid. What is
left of a homography and a polynomial on top of it is noise, before any camera is known: what a
calibration can reach with these pictures.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from binopos_ros.calibration.views.view import View

DEGREE = 4  # follows wide lenses to a hundredth of a pixel; fewer where points are few


def corner_variance(view: View, side: int) -> float:
    """The variance of a pixel coordinate of one picture of a view (px^2); nan from few points."""
    seen = np.isfinite(view.pixels[side]).all(axis=1)
    count = int(seen.sum())
    degree = max((d for d in range(DEGREE + 1) if (d + 1) * (d + 2) <= count), default=0)
    if degree < 2:
        return float('nan')
    board, pixels = view.points[seen, :2], view.pixels[side][seen]
    homography, _ = cv2.findHomography(board, pixels)
    if homography is None:
        return float('nan')
    flat = np.column_stack([board, np.ones(count)]) @ homography.T
    rest = pixels - flat[:, :2] / flat[:, 2:]
    x, y = (2.0 * (board - board.min(axis=0)) / np.ptp(board, axis=0) - 1.0).T
    terms = [x**i * y**j for i in range(degree + 1) for j in range(degree + 1 - i)]
    design = np.linalg.qr(np.stack(terms, axis=1))[0]
    rest = rest - design @ (design.T @ rest)
    return float(np.sum(rest**2)) / (2.0 * (count - len(terms)))


def corner_noise(views: Sequence[View]) -> float:
    """The standard deviation of a pixel coordinate over all pictures (px), by the median."""
    found = [corner_variance(view, side) for view in views for side in range(len(view.pixels))]
    known = [one for one in found if np.isfinite(one)]
    return float(np.sqrt(np.median(known))) if known else float('nan')
