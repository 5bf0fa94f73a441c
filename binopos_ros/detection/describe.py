"""Describe: what a red patch looks like, in numbers to judge it by."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from . import moments
from .arcs import Arcs, find_arcs
from .colour import Hue, hue
from .images import Frame
from .search import Sighting
from .target import Ellipse

WHOLE_FIT, ROUGHNESS, LEAST_WIDTH = 0.97, 0.2, 6.0
"""A patch that agrees less with its ellipse may be a part of a circle: the share of agreement,
what raggedness takes of it (pixels along the minor axis), the least minor axis to tell by, px."""

HALF_A_PIXEL = 0.5
"""A border runs through the middle of the outermost pixels."""


class Description(NamedTuple):
    """A patch in numbers.

    outline is the ellipse of its moments in px of the image, fit the share in which patch and
    ellipse agree, width the minor axis in the reduced pixels of the sighting, cut whether the edge
    of the image cuts it. redness and contrast are as of `Candidate`. arcs is what is seen of a
    round outline where that tells more than the ellipse, and outline then that of the circle.
    """

    sighting: Sighting
    cutout: moments.Cutout
    outline: Ellipse
    fit: float
    width: float
    redness: float
    contrast: float
    hue: Hue
    cut: bool
    arcs: Arcs | None

    @property
    def misfit(self) -> float:
        """The share in which an outline is more than ragged, where no arcs of a circle say why."""
        if self.arcs is not None:
            return 0.0
        return max(WHOLE_FIT - 3 * ROUGHNESS / max(self.width, 1.0) - self.fit, 0.0)


def describe(frame: Frame, sighting: Sighting) -> Description:
    """Describe a patch of a frame."""
    ellipse, fit = _shape(sighting.patch.mask)
    if fit < WHOLE_FIT:
        # A highlight is a hole in the patch, and none in the target.
        patch = sighting.patch._replace(mask=_filled(sighting.patch.mask))
        sighting = sighting._replace(patch=patch)
        ellipse, fit = _shape(patch.mask)
    patch = sighting.patch
    outline = _placed(ellipse, patch.box, sighting)
    factor = sighting.factor
    width = 2 * outline.semi_axes[1] / factor
    ends = _ends(sighting, frame)
    arcs = None
    if width >= LEAST_WIDTH and (any(ends) or fit < WHOLE_FIT - ROUGHNESS / width):
        arcs = find_arcs(patch.mask, factor, ellipse, ends)
    if arcs is not None:
        spread = (arcs.radius + HALF_A_PIXEL) ** 2 / 4
        circle = moments.Moments(arcs.u, arcs.v, spread, 0.0, spread)
        outline = _placed(circle, patch.box, sighting)
    cutout = moments.cut_out(sighting.pixels, patch.mask, patch.box[:2], factor)
    return Description(
        sighting,
        cutout,
        outline,
        fit,
        width=width,
        redness=patch.inside,
        contrast=patch.inside - patch.outside,
        hue=hue(cutout.inside, cutout.around),
        cut=any(ends),
        arcs=arcs,
    )


def covered(seen: Description) -> Ellipse:
    """Give the outline by the share of the pixels that the patch covers, in px of the image.

    Raises DetectionError where the patch has no colour of its own, or too little is covered.
    """
    if seen.arcs is not None:
        return seen.outline
    sighting, cutout = seen.sighting, seen.cutout
    return _placed(moments.covered(cutout, sighting.factor), cutout.corner, sighting)


def _filled(mask: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[-2]
    filled = mask.copy()
    cv2.drawContours(filled, outlines, -1, 1, cv2.FILLED)
    return filled


def _ends(seen: Sighting, frame: Frame) -> tuple[bool, bool, bool, bool]:
    """Whether the image ends on the left, the upper, the right and the lower side of a patch."""
    factor, (left, top) = seen.factor, seen.origin
    x0, y0, x1, y1 = seen.patch.box
    return (
        x0 * factor + left <= 0,
        y0 * factor + top <= 0,
        (x1 + 1) * factor + left > frame.width,
        (y1 + 1) * factor + top > frame.height,
    )


def _shape(mask: npt.NDArray[np.uint8]) -> tuple[moments.Moments, float]:
    """The moments of a mask, and how well the ellipse of these agrees with it."""
    m = cv2.moments(mask)
    area = m['m00']
    u, v = m['m10'] / area, m['m01'] / area
    uu, vv, uv = m['mu20'] / area + 1 / 12, m['mu02'] / area + 1 / 12, m['mu11'] / area
    height, width = mask.shape
    x, y = np.arange(-u, width - u - 0.5), np.arange(-v, height - v - 0.5)[:, None]
    determinant = uu * vv - uv * uv
    a, b, d = vv / (4 * determinant), -uv / (4 * determinant), uu / (4 * determinant)
    ellipse = ((a * x + 2 * b * y) * x < 1 - d * y * y).view(np.uint8)
    # The ellipse reaches beyond the patch's box where the two differ; its area does not show that.
    full = max(4 * math.pi * math.sqrt(determinant), cv2.countNonZero(ellipse))
    both = cv2.countNonZero(ellipse & mask)
    return moments.Moments(u, v, uu, uv, vv), both / (full + area - both)


def _placed(found: moments.Moments, corner: tuple[int, ...], seen: Sighting) -> Ellipse:
    """Moments in a part of the reduced pixels with that corner, as an ellipse of the image."""
    factor = seen.factor
    u = (corner[0] + found.u + 0.5) * factor - 0.5 + seen.origin[0]
    v = (corner[1] + found.v + 0.5) * factor - 0.5 + seen.origin[1]
    uu, uv, vv = (each * factor**2 for each in (found.uu, found.uv, found.vv))
    return Ellipse(np.array([u, v]), np.array([[uu, uv], [uv, vv]]))
