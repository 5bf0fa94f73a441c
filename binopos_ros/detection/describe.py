"""Describe: what a red patch looks like, in numbers to judge it by."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from . import moments
from .colour import Hue, hue
from .images import Frame
from .search import Sighting
from .target import Ellipse


class Description(NamedTuple):
    """A patch in numbers.

    outline is the ellipse of its moments in px of the image, fit the share in which patch and
    ellipse agree, width the minor axis in the reduced pixels of the sighting, cut whether the edge
    of the image cuts it. redness and contrast are as of `Candidate`.
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


def describe(frame: Frame, sighting: Sighting) -> Description:
    """Describe a patch of a frame."""
    patch = sighting.patch
    outline, fit = _shape(sighting)
    factor = sighting.factor
    cutout = moments.cut_out(sighting.pixels, patch.mask, patch.box[:2], factor)
    return Description(
        sighting,
        cutout,
        outline,
        fit,
        width=2 * outline.semi_axes[1] / factor,
        redness=patch.inside,
        contrast=patch.inside - patch.outside,
        hue=hue(cutout.inside, cutout.around),
        cut=_is_cut(sighting, frame),
    )


def covered(seen: Description) -> Ellipse:
    """Give the outline by the share of the pixels that the patch covers, in px of the image.

    Raises DetectionError where the patch has no colour of its own, or too little is covered.
    """
    sighting, cutout = seen.sighting, seen.cutout
    return _placed(moments.covered(cutout, sighting.factor), cutout.corner, sighting)


def _is_cut(seen: Sighting, frame: Frame) -> bool:
    factor, (left, top) = seen.factor, seen.origin
    x0, y0, x1, y1 = seen.patch.box
    return (
        x0 * factor + left <= 0
        or y0 * factor + top <= 0
        or (x1 + 1) * factor + left > frame.width
        or (y1 + 1) * factor + top > frame.height
    )


def _shape(seen: Sighting) -> tuple[Ellipse, float]:
    """The ellipse of a patch's moments, in px of the image, and how well the two agree."""
    mask = seen.patch.mask
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
    outline = _placed(moments.Moments(u, v, uu, uv, vv), seen.patch.box, seen)
    return outline, both / (full + area - both)


def _placed(found: moments.Moments, corner: tuple[int, ...], seen: Sighting) -> Ellipse:
    """Moments in a part of the reduced pixels with that corner, as an ellipse of the image."""
    factor = seen.factor
    u = (corner[0] + found.u + 0.5) * factor - 0.5 + seen.origin[0]
    v = (corner[1] + found.v + 0.5) * factor - 0.5 + seen.origin[1]
    uu, uv, vv = (each * factor**2 for each in (found.uu, found.uv, found.vv))
    return Ellipse(np.array([u, v]), np.array([[uu, uv], [uv, vv]]))
