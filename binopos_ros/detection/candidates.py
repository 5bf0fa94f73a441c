"""Candidates: red patches, their shapes, and which of them is the target.

Patches are found in a reduced picture, and outlined at a scale where they are large enough to show
their shape and small enough to be quick.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from . import moments
from .colour import redness
from .errors import DetectionError
from .images import Frame, Picture
from .options import DetectorOptions
from .patches import (
    Patch,
    frame_of,
    median,
    noise_of,
    outlined,
    reaches_over,
    seeds,
    settled_about,
)
from .target import Candidate, Ellipse

SEARCH_WIDTH = 320
SHAPE_SIZE = 8
LEAST_SIDE = 3


class _Map(NamedTuple):
    """A reduced map: its pixels, by what factor it is reduced, and its corner in the image, px."""

    pixels: Picture
    factor: int
    origin: tuple[int, int]


def search_factor(frame: Frame) -> int:
    """Give the factor by which a frame is reduced to be searched: 1 or even."""
    factor = 1
    shorter, longer = sorted((frame.width, frame.height))
    while longer / factor > SEARCH_WIDTH * 1.5 and shorter / factor >= 2 * LEAST_SIDE:
        factor *= 2
    return factor


def find(frame: Frame, options: DetectorOptions) -> tuple[list[Candidate], float]:
    """Find the candidates in a frame, the best first, and the contrast that was asked of them.

    Those refused bear their reason; the first without one is the target.
    """
    factor = search_factor(frame)
    pixels = frame.reduced(factor, 0, 0, frame.width, frame.height)
    shades = redness(pixels)
    threshold = max(options.min_contrast, options.noise_factor * noise_of(shades))
    candidates: list[Candidate] = []
    if min(shades.shape) < LEAST_SIDE:
        return candidates, threshold
    for column, row, size in seeds(shades, threshold):
        patch = outlined(shades, column, row, size)
        if patch is None:
            continue
        seen = _Map(pixels, factor, (0, 0))
        candidate = _described(frame, patch, seen, threshold, options)
        if candidate is None or any(_same(candidate, other) for other in candidates):
            continue
        candidates.append(candidate)
    candidates.sort(key=lambda each: (bool(each.reason), -each.score))
    if options.mirror_above:
        candidates = _without_mirror_images(candidates)
    return candidates, threshold


def follow(
    frame: Frame,
    place: tuple[float, float],
    diameter: float,
    slack: float,
    options: DetectorOptions,
) -> tuple[Candidate | None, float]:
    """Find the patch at a place, px, or within `slack` px of it, and the contrast asked of it.

    Where the patch is the one that `find` would find, its outline is the same to the last digit:
    the blocks are the same, and a patch that the window does not show with all that it is judged
    by is none.
    """
    factor = search_factor(frame)
    # As much as is looked at about a patch of that diameter.
    margin = max(diameter / 8 + 3 * factor, moments.margin(factor) * factor)
    reach = diameter / 2 + margin + factor + max(slack, 2 * factor)
    u, v = place
    x0, y0 = (max(int((each - reach) // factor), 0) for each in place)
    x1 = min(int((u + reach) // factor) + 1, frame.width // factor)
    y1 = min(int((v + reach) // factor) + 1, frame.height // factor)
    if min(x1 - x0, y1 - y0) < LEAST_SIDE:
        return None, options.min_contrast
    pixels = frame.reduced(factor, x0 * factor, y0 * factor, x1 * factor, y1 * factor)
    shades = redness(pixels)
    threshold = max(options.min_contrast, options.noise_factor * noise_of(shades))
    outside = median(frame_of(shades))
    column, row = int(u / factor) - x0, int(v / factor) - y0
    shown = 0 <= column < x1 - x0 and 0 <= row < y1 - y0
    inside = float(shades[row, column]) if shown else outside
    if inside - outside < threshold:
        size = int(diameter / factor / 2) | 1
        _, inside, _, (column, row) = cv2.minMaxLoc(cv2.blur(shades, (size, size)))
    patch = settled_about(shades, column, row, inside, outside)
    whole = (-x0, -y0, frame.width // factor - x0, frame.height // factor - y0)
    near_least = moments.margin(factor)
    if patch is None or reaches_over(patch.near(near_least), (0, 0, x1 - x0, y1 - y0), whole):
        return None, threshold
    seen = _Map(pixels, factor, (x0 * factor, y0 * factor))
    return _described(frame, patch, seen, threshold, options), threshold


def others(frame: Frame, chosen: Candidate, options: DetectorOptions) -> list[Candidate]:
    """Find the candidates elsewhere in a frame than the one that was followed."""
    reason = 'the target was followed elsewhere'
    return [
        each if each.reason else replace(each, reason=reason)
        for each in find(frame, options)[0]
        if not _same(each, chosen)
    ]


def _described(
    frame: Frame, patch: Patch, seen: _Map, threshold: float, options: DetectorOptions
) -> Candidate | None:
    """Outline a patch at the scale that suits its size, and judge it."""
    factor, (left, top) = seen.factor, seen.origin
    x0, y0, x1, y1 = patch.box
    size = max(x1 - x0, y1 - y0)
    finer = factor
    while finer > 1 and size * factor / finer < SHAPE_SIZE:
        finer //= 2
    if finer < factor:
        margin = size // 2 + 4
        wide = (
            max((x0 - margin) * factor + left, 0),
            max((y0 - margin) * factor + top, 0),
            min((x1 + margin) * factor + left, frame.width),
            min((y1 + margin) * factor + top, frame.height),
        )
        seen = _Map(frame.reduced(finer, *wide), finer, wide[:2])
        shades = np.asarray(cv2.blur(redness(seen.pixels), (3, 3)), np.float32)
        rows, columns = np.nonzero(patch.mask)
        k = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
        column = ((x0 + columns[k] + 0.5) * factor + left - wide[0]) / finer
        row = ((y0 + rows[k] + 0.5) * factor + top - wide[1]) / finer
        column = min(int(column), shades.shape[1] - 1)
        row = min(int(row), shades.shape[0] - 1)
        settled = settled_about(shades, column, row, patch.inside, patch.outside)
        if settled is None:
            return None
        patch = settled
    outline, fit = _shape(patch, seen)
    contrast = patch.inside - patch.outside
    cut = _is_cut(patch, seen, frame)
    reason = _refusal(outline, fit, patch, cut, threshold, options)
    major, minor = outline.semi_axes
    score = contrast * fit**4 * math.sqrt(major * minor)
    if not reason:
        try:
            outline = _covered(patch, seen)
        except DetectionError as error:
            reason = str(error)
    return Candidate(outline, contrast, patch.inside, fit, score, reason)


def _is_cut(patch: Patch, seen: _Map, frame: Frame) -> bool:
    factor, (left, top) = seen.factor, seen.origin
    x0, y0, x1, y1 = patch.box
    return (
        x0 * factor + left <= 0
        or y0 * factor + top <= 0
        or (x1 + 1) * factor + left > frame.width
        or (y1 + 1) * factor + top > frame.height
    )


def _shape(patch: Patch, seen: _Map) -> tuple[Ellipse, float]:
    """The ellipse of a patch's moments, in px of the image, and how well the two agree."""
    m = cv2.moments(patch.mask)
    area = m['m00']
    u, v = m['m10'] / area, m['m01'] / area
    uu, vv, uv = m['mu20'] / area + 1 / 12, m['mu02'] / area + 1 / 12, m['mu11'] / area
    height, width = patch.mask.shape
    x, y = np.arange(-u, width - u - 0.5), np.arange(-v, height - v - 0.5)[:, None]
    determinant = uu * vv - uv * uv
    a, b, d = vv / (4 * determinant), -uv / (4 * determinant), uu / (4 * determinant)
    ellipse = ((a * x + 2 * b * y) * x < 1 - d * y * y).view(np.uint8)
    # The ellipse reaches beyond the patch's box where the two differ; its area does not show that.
    full = max(4 * math.pi * math.sqrt(determinant), cv2.countNonZero(ellipse))
    both = cv2.countNonZero(ellipse & patch.mask)
    return _placed(moments.Moments(u, v, uu, uv, vv), patch.box, seen), both / (full + area - both)


def _covered(patch: Patch, seen: _Map) -> Ellipse:
    """The outline by the share of the pixels that the patch covers, in px of the image."""
    height, width = seen.pixels.shape[:2]
    x0, y0, x1, y1 = patch.box
    margin = moments.margin(seen.factor)
    left, top = max(x0 - margin, 0), max(y0 - margin, 0)
    pixels = seen.pixels[top : min(y1 + margin, height), left : min(x1 + margin, width)]
    mask = np.zeros(pixels.shape[:2], np.uint8)
    mask[y0 - top : y1 - top, x0 - left : x1 - left] = patch.mask
    return _placed(moments.covered(pixels, mask, seen.factor), (left, top), seen)


def _placed(found: moments.Moments, corner: tuple[int, ...], seen: _Map) -> Ellipse:
    """Moments in a part of a map with that corner, as an ellipse in px of the image."""
    factor = seen.factor
    u = (corner[0] + found.u + 0.5) * factor - 0.5 + seen.origin[0]
    v = (corner[1] + found.v + 0.5) * factor - 0.5 + seen.origin[1]
    uu, uv, vv = (each * factor**2 for each in (found.uu, found.uv, found.vv))
    return Ellipse(np.array([u, v]), np.array([[uu, uv], [uv, vv]]))


def _refusal(
    outline: Ellipse,
    fit: float,
    patch: Patch,
    cut: bool,
    threshold: float,
    options: DetectorOptions,
) -> str:
    major, minor = outline.semi_axes
    contrast = patch.inside - patch.outside
    if contrast < threshold:
        return f'contrast {contrast:.2f} is below {threshold:.2f}'
    if patch.inside < options.min_redness:
        return f'redness {patch.inside:.2f} is below {options.min_redness:.2f}'
    if cut:
        return 'cut by the edge of the image'
    if 2 * major < options.min_diameter:
        return f'diameter {2 * major:.1f} px is below {options.min_diameter:.1f} px'
    if 2 * major > options.max_diameter:
        return f'diameter {2 * major:.1f} px is above {options.max_diameter:.1f} px'
    if minor < options.min_axis_ratio * major:
        return f'axis ratio {minor / major:.2f} is below {options.min_axis_ratio:.2f}'
    if fit < options.min_fit:
        return f'shape agrees with an ellipse by {fit:.2f}, less than {options.min_fit:.2f}'
    return ''


def _same(one: Candidate, other: Candidate) -> bool:
    distance = math.dist(one.outline.centre.tolist(), other.outline.centre.tolist())
    return distance < 0.5 * min(one.outline.semi_axes[0], other.outline.semi_axes[0]) + 1


def _without_mirror_images(candidates: list[Candidate]) -> list[Candidate]:
    """Refuse whatever has a like patch below it: its own mirror image lies above a target."""
    good = [each for each in candidates if not each.reason]
    if len(good) < 2:
        return candidates
    out = []
    for each in candidates:
        below = next((low for low in good if _is_mirror_image(each, low)), None)
        if each.reason or below is None:
            out.append(each)
            continue
        u, v = below.outline.centre
        reason = f'mirror image of the patch at ({u:.0f}, {v:.0f}) below'
        out.append(replace(each, reason=reason))
    return sorted(out, key=lambda each: (bool(each.reason), -each.score))


def _is_mirror_image(upper: Candidate, lower: Candidate) -> bool:
    du, dv = lower.outline.centre - upper.outline.centre
    size = lower.outline.semi_axes[0] * 2
    like = 0.5 < upper.outline.semi_axes[0] * 2 / size < 2
    return bool(
        like
        and dv > size
        and abs(du) < max(0.2 * dv, size)
        and lower.contrast > 0.6 * upper.contrast
    )
