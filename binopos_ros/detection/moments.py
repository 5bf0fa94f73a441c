"""An outline from the moments of the share of each pixel that the target covers.

For that share a pixel's colour is projected on the line from the surroundings' colour to the
target's. Colours mix along it, so pixels that are means over blocks serve as well as those of the
camera: the outline is good to a tenth of a pixel of the camera's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .images import Picture

EDGE, RING = 4.0, 5.0
"""px of the camera: about an outline its edge may show so far; the surroundings' colour is taken
from the pixels farther off."""

LEAST_CONTRAST = 3.0
SQUARE = np.ones((3, 3), np.uint8)


class Moments(NamedTuple):
    """The centre, and the second central moments of what is enclosed, in pixels."""

    u: float
    v: float
    uu: float
    uv: float
    vv: float


def margin(factor: int) -> int:
    """Give how far about a patch the pixels must reach, where they are blocks of that side."""
    return math.ceil(EDGE / factor) + math.ceil(RING / factor)


def covered(pixels: Picture, patch: npt.NDArray[np.uint8], factor: int) -> Moments:
    """Give the moments of the share that the target covers of pixels about a patch.

    pixels is (height, width, 3) uint8, the means over blocks of factor x factor; patch (height,
    width) is 1 for those that are at least half covered. Raises DetectionError where the two
    colours are the same or too little is covered.
    """
    steps = math.ceil(EDGE / factor)
    outer = cv2.dilate(patch, SQUARE, iterations=steps)
    core = cv2.erode(patch, SQUARE, iterations=steps, borderValue=0)
    blue, green, red, _ = cv2.mean(pixels, core if cv2.countNonZero(core) else patch)
    around = cv2.mean(pixels, 1 - outer)
    b, g, r = blue - around[0], green - around[1], red - around[2]
    power = b * b + g * g + r * r
    if power < LEAST_CONTRAST**2:
        msg = 'the patch is of the same colour as its surroundings'
        raise DetectionError(msg)
    level = b * around[0] + g * around[1] + r * around[2]
    row = np.array([[b / power, g / power, r / power, -level / power]], np.float32)
    share = cv2.copyTo(cv2.transform(pixels.astype(np.float32), row), outer)
    np.copyto(share, 1, where=core.view(np.bool_))
    m = cv2.moments(share)
    area = m['m00']
    if not area * factor * factor > 4:
        msg = 'no area is left within the outline'
        raise DetectionError(msg)
    # What the block's own extent adds to the moments, beside that of the camera's pixels.
    own = (1 - 1 / factor**2) / 12
    uu, uv, vv = m['mu20'] / area + own, m['mu11'] / area, m['mu02'] / area + own
    if not (uu > 0 and vv > 0 and (uu * vv - uv * uv) * factor**4 > 0.01):
        msg = 'the area within the outline has no width'
        raise DetectionError(msg)
    return Moments(m['m10'] / area, m['m01'] / area, uu, uv, vv)
