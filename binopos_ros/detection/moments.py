"""An outline from the moments of the share of each pixel that the target covers.

That share is where a pixel's redness lies between the surroundings' and the target's: a limb in
shadow is as red as the rest. Pixels that are means over blocks serve nearly as well as those of
the camera: the outline is good to some tenths of a pixel of the camera's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .colour import redness, redness_of
from .errors import DetectionError
from .images import Picture

EDGE, RING = 4.0, 5.0
"""px of the camera: about an outline its edge may show so far; the surroundings' colour is taken
from the pixels farther off."""

LEAST_CONTRAST = 3.0
SQUARE = np.ones((3, 3), np.uint8)


class Cutout(NamedTuple):
    """The pixels about a patch, and their two colours.

    core is what lies well within the patch, outer all that its edge may reach, both masks of 0 and
    1; inside and around are mean colours, blue, green, red. corner is the cut-out's own, in the
    pixels that it was cut from.
    """

    pixels: Picture
    core: npt.NDArray[np.uint8]
    outer: npt.NDArray[np.uint8]
    inside: tuple[float, ...]
    around: tuple[float, ...]
    corner: tuple[int, int]


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


def cut_out(
    pixels: Picture, mask: npt.NDArray[np.uint8], corner: tuple[int, int], factor: int
) -> Cutout:
    """Cut a patch out of pixels (height, width, 3) uint8, means over blocks of factor x factor.

    mask is 1 for those that are at least half covered; corner is where its own lies.
    """
    (column, row), (height, width) = corner, mask.shape
    reach = margin(factor)
    left, top = max(column - reach, 0), max(row - reach, 0)
    part = pixels[top : row + height + reach, left : column + width + reach]
    patch = np.zeros(part.shape[:2], np.uint8)
    patch[row - top : row - top + height, column - left : column - left + width] = mask
    steps = math.ceil(EDGE / factor)
    outer = np.asarray(cv2.dilate(patch, SQUARE, iterations=steps), np.uint8)
    core = np.asarray(cv2.erode(patch, SQUARE, iterations=steps, borderValue=0), np.uint8)
    inside = cv2.mean(part, core if cv2.countNonZero(core) else patch)
    around = cv2.mean(part, 1 - outer)
    return Cutout(part, core, outer, tuple(inside[:3]), tuple(around[:3]), (left, top))


def covered(cutout: Cutout, factor: int) -> Moments:
    """Give the moments of the share of its pixels that a patch covers.

    Raises DetectionError where the two colours are the same or too little is covered.
    """
    pixels, core, outer, inside, around, _ = cutout
    if math.dist(inside, around) < LEAST_CONTRAST:
        msg = 'the patch is of the same colour as its surroundings'
        raise DetectionError(msg)
    low, high = (redness_of(each) for each in (around, inside))
    if not high > low:
        msg = 'the patch is no redder than its surroundings'
        raise DetectionError(msg)
    share = cv2.copyTo((redness(pixels) - np.float32(low)) * np.float32(1 / (high - low)), outer)
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
