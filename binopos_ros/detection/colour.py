"""Redness, and where it stands out.

Redness is (R - G) / (R + G + B + c): a chromatic quantity, so brightness cancels. Water takes red
first, which lowers the redness of target and surroundings alike, so a patch is judged by its
contrast to what surrounds it. The constant keeps the noise of dark pixels small.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from .images import Picture

Map = npt.NDArray[np.float32]

DARK = 24.0
_NUMERATOR_AND_SUM = np.array([[0.0, -1.0, 1.0, 0.0], [1.0, 1.0, 1.0, DARK]], np.float32)


def redness(bgr: Picture) -> Map:
    """Give (R - G) / (R + G + B + 24), (height, width) float32, of blue-green-red pixels."""
    both = cv2.transform(bgr.astype(np.float32), _NUMERATOR_AND_SUM)
    return np.asarray(both[..., 0] / both[..., 1], np.float32)
