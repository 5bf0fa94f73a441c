"""The paper's rule (Sec. 2.5 and 5.2): fixed levels, and the middle of the four extremes."""

from __future__ import annotations

import cv2
import numpy as np

from .images import Frame, Picture
from .target import Detection, Ellipse, Target

EXTREME_VARIANCE = 1 / 12
"""px^2; an extreme is a whole pixel, so its place is uniform over one."""


def detect_by_extremes(frame: Frame, red: int = 168, green: int = 50) -> Detection:
    """Find the middle of the left-, right-, upper- and lowermost pixels with R > red, G < green.

    The covariance is that of rounding the four extremes to whole pixels, (1/12 + 1/12) / 4 px^2
    per coordinate. The rule knows neither noise nor blur nor a second red patch, so its errors
    are larger than that.
    """
    return _detect(frame.window(0, 0, frame.width, frame.height), red, green)


def _detect(bgr: Picture, red: int, green: int) -> Detection:
    if red >= 255 or green <= 0:
        return Detection(None, f'no pixel has R > {red} and G < {green}')
    mask = cv2.inRange(bgr, (0, 0, red + 1), (255, green - 1, 255))
    left, top, width, height = cv2.boundingRect(mask)
    if not width:
        return Detection(None, f'no pixel has R > {red} and G < {green}')
    centre = np.array([left + (width - 1) / 2, top + (height - 1) / 2])
    outline = Ellipse(centre, np.diag([width**2 / 16, height**2 / 16]))
    covariance = np.eye(2) * (2 * EXTREME_VARIANCE / 4)
    return Detection(Target(centre, covariance, float(max(width, height)), outline))
