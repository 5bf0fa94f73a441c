"""Red patches, their shapes, and which of them is the target.

A patch is first seen where the redness of a square stands out from that of the frame around it,
at one of several sizes an octave apart. It is then outlined half-way between its own redness and
its surroundings', at a scale where it is large enough to show its shape and small enough to be
quick.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .colour import Map, redness
from .images import Frame
from .options import DetectorOptions
from .target import Candidate, Ellipse

Window = tuple[int, int, int, int]

SEARCH_WIDTH = 320
SHAPE_SIZE = 10
MAX_SEEDS = 16
MOST_CUTS = 5
LEAST_SIDE = 3
NOISE_STEP = 3
NEIGHBOURS = np.ones((3, 3), np.uint8)


class _Patch(NamedTuple):
    """A patch in pixels of a reduced map, with the part of the map that it was judged by."""

    box: Window
    near: Window
    mask: npt.NDArray[np.uint8]
    inside: float
    outside: float


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
    shades = redness(frame.reduced(factor, 0, 0, frame.width, frame.height))
    threshold = max(options.min_contrast, options.noise_factor * _noise(shades))
    candidates: list[Candidate] = []
    if min(shades.shape) < LEAST_SIDE:
        return candidates, threshold
    for column, row, size in _seeds(shades, threshold):
        patch = _outlined(shades, column, row, size)
        if patch is None:
            continue
        candidate = _described(frame, patch, factor, (0, 0), threshold, options)
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
    # As much as `_settled` looks at about a patch of that diameter.
    reach = diameter * (1 / 2 + 1 / 8) + 3 * factor + max(slack, 2 * factor)
    u, v = place
    x0, y0 = (max(int((each - reach) // factor), 0) for each in place)
    x1 = min(int((u + reach) // factor) + 1, frame.width // factor)
    y1 = min(int((v + reach) // factor) + 1, frame.height // factor)
    if min(x1 - x0, y1 - y0) < LEAST_SIDE:
        return None, options.min_contrast
    shades = redness(frame.reduced(factor, *(each * factor for each in (x0, y0, x1, y1))))
    threshold = max(options.min_contrast, options.noise_factor * _noise(shades))
    size = int(diameter / factor / 2) | 1
    smooth = cv2.blur(shades, (size, size))
    column, row = int(u / factor) - x0, int(v / factor) - y0
    outside = _median(_frame_of(shades))
    if not (
        0 <= column < x1 - x0
        and 0 <= row < y1 - y0
        and min(smooth[row, column], shades[row, column]) - outside > threshold
    ):
        column, row = cv2.minMaxLoc(smooth)[3]
    patch = _settled(shades, column, row, float(smooth[row, column]), outside)
    whole = (-x0, -y0, frame.width // factor - x0, frame.height // factor - y0)
    if patch is None or _reaches_over(patch.near, (0, 0, x1 - x0, y1 - y0), whole):
        return None, threshold
    origin = (x0 * factor, y0 * factor)
    return _described(frame, patch, factor, origin, threshold, options), threshold


def _noise(shades: Map) -> float:
    rest = (shades - cv2.blur(shades, (3, 3)))[::NOISE_STEP, ::NOISE_STEP]
    return 1.5 * _median(np.abs(rest))


def _median(values: Map) -> float:
    """The median; of an even number of values, the upper of the middle two."""
    flat, middle = values.ravel(), values.size // 2
    flat.partition(middle)
    return float(flat[middle])


def _seeds(shades: Map, threshold: float) -> list[tuple[int, int, int]]:
    """Where the redness stands out: column, row and the size of the square, strongest first."""
    contrasts: list[Map] = []
    means = shades
    sizes = [1]
    while sizes[-1] < min(shades.shape) / 2:
        inner, size = sizes[-1], sizes[-1] * 2 + 1
        wider = cv2.blur(shades, (size, size), borderType=cv2.BORDER_REFLECT)
        contrast = (means - wider) * np.float32(size**2 / (size**2 - inner**2))
        contrasts.append(contrast)
        sizes.append(size)
        means = np.asarray(wider, np.float32)
    best = contrasts[0]
    for each in contrasts[1:]:
        best = np.maximum(best, each)
    peaks = (best >= cv2.dilate(best, NEIGHBOURS)) & (best > threshold * 0.75)
    rows, columns = np.nonzero(peaks)
    scales = np.argmax([each[rows, columns] for each in contrasts], axis=0)
    order = np.argsort(-best[rows, columns], kind='stable')[:MAX_SEEDS]
    return [(int(columns[k]), int(rows[k]), sizes[scales[k]]) for k in order]


def _outlined(shades: Map, column: int, row: int, size: int) -> _Patch | None:
    """The patch about a pixel, cut half-way between its redness and its surroundings'."""
    height, width = shades.shape
    whole = (0, 0, width, height)
    half = size + 2
    for _ in range(6):
        x0, y0 = max(column - half, 0), max(row - half, 0)
        x1, y1 = min(column + half + 1, width), min(row + half + 1, height)
        part = shades[y0:y1, x0:x1]
        reach = size // 2
        square = shades[
            max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1
        ]
        inside, outside = cv2.mean(square)[0], _median(_frame_of(part))
        patch = _settled(part, column - x0, row - y0, inside, outside)
        if patch is None:
            return None
        box, near = (
            (left + x0, top + y0, right + x0, bottom + y0)
            for left, top, right, bottom in (patch.box, patch.near)
        )
        if not _reaches_over(near, (x0, y0, x1, y1), whole):
            return patch._replace(box=box, near=near)
        half *= 2
    return None


def _reaches_over(near: Window, part: Window, whole: Window) -> bool:
    """Whether a part of the whole shows less of it than what is near."""
    return (
        max(near[0], whole[0]) < part[0]
        or max(near[1], whole[1]) < part[1]
        or min(near[2], whole[2]) > part[2]
        or min(near[3], whole[3]) > part[3]
    )


def _settled(part: Map, column: int, row: int, inside: float, outside: float) -> _Patch | None:
    """Cut, take the means on both sides, and cut again until the patch stays as it is.

    Where it ends depends on the pixels near the patch alone.
    """
    area, patch = 0, None
    for _ in range(MOST_CUTS):
        above = (part > (inside + outside) / 2).view(np.uint8)
        if not above[row, column]:
            return None
        size, *_, (x, y, w, h) = cv2.floodFill(above, None, (column, row), 2)
        # A patch lies within the one that is cut lower, so the same size is the same patch.
        if size == area:
            break
        area = size
        margin = 2 + max(w, h) // 8
        near = (x - margin, y - margin, x + w + margin, y + h + margin)
        left, top = max(near[0], 0), max(near[1], 0)
        seen = part[top : near[3], left : near[2]]
        mask = (above[top : near[3], left : near[2]] == 2).view(np.uint8)
        around = seen[cv2.dilate(mask, NEIGHBOURS) == 0]
        if around.size < 4:
            return None
        core = cv2.erode(mask, NEIGHBOURS, borderValue=0)
        inside = cv2.mean(seen, core if cv2.countNonZero(core) else mask)[0]
        outside = _median(around)
        inner = mask[y - top : y - top + h, x - left : x - left + w]
        patch = _Patch((x, y, x + w, y + h), near, inner, inside, outside)
    return patch


def _frame_of(part: Map) -> Map:
    return np.concatenate([part[0], part[-1], part[1:-1, 0], part[1:-1, -1]])


def _described(
    frame: Frame,
    patch: _Patch,
    factor: int,
    origin: tuple[int, int],
    threshold: float,
    options: DetectorOptions,
) -> Candidate | None:
    """Outline a patch at the scale that suits its size, and judge it."""
    x0, y0, x1, y1 = patch.box
    size = max(x1 - x0, y1 - y0)
    finer = factor
    while finer > 1 and size * factor / finer < SHAPE_SIZE:
        finer //= 2
    if finer < factor:
        margin = size // 2 + 4
        wide = (
            max((x0 - margin) * factor + origin[0], 0),
            max((y0 - margin) * factor + origin[1], 0),
            min((x1 + margin) * factor + origin[0], frame.width),
            min((y1 + margin) * factor + origin[1], frame.height),
        )
        shades = np.asarray(cv2.blur(redness(frame.reduced(finer, *wide)), (3, 3)), np.float32)
        rows, columns = np.nonzero(patch.mask)
        k = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
        column = ((x0 + columns[k] + 0.5) * factor + origin[0] - wide[0]) / finer
        row = ((y0 + rows[k] + 0.5) * factor + origin[1] - wide[1]) / finer
        column = min(int(column), shades.shape[1] - 1)
        row = min(int(row), shades.shape[0] - 1)
        settled = _settled(shades, column, row, patch.inside, patch.outside)
        if settled is None:
            return None
        patch, origin = settled, (wide[0], wide[1])
    outline, fit = _shape(patch, finer, origin)
    cut = _is_cut(patch, finer, origin, frame)
    return _judged(outline, fit, patch, cut, threshold, options)


def _is_cut(patch: _Patch, factor: int, origin: tuple[int, int], frame: Frame) -> bool:
    x0, y0, x1, y1 = patch.box
    return (
        x0 * factor + origin[0] <= 0
        or y0 * factor + origin[1] <= 0
        or (x1 + 1) * factor + origin[0] > frame.width
        or (y1 + 1) * factor + origin[1] > frame.height
    )


def _shape(patch: _Patch, factor: int, origin: tuple[int, int]) -> tuple[Ellipse, float]:
    """The ellipse of a patch's moments, in px of the image, and how well the two agree."""
    m = cv2.moments(patch.mask, binaryImage=True)
    area = m['m00']
    u, v = m['m10'] / area, m['m01'] / area
    uu, vv, uv = m['mu20'] / area + 1 / 12, m['mu02'] / area + 1 / 12, m['mu11'] / area
    height, width = patch.mask.shape
    x, y = np.arange(-u, width - u - 0.5), np.arange(-v, height - v - 0.5)[:, None]
    determinant = uu * vv - uv * uv
    a, b, d = (each / (4 * determinant) for each in (vv, -uv, uu))
    ellipse = ((a * x + 2 * b * y) * x < 1 - d * y * y).view(np.uint8)
    # The ellipse reaches beyond the patch's box where the two differ; its area does not show that.
    full = max(4 * math.pi * math.sqrt(determinant), cv2.countNonZero(ellipse))
    both = cv2.countNonZero(ellipse & patch.mask)
    fit = both / (full + area - both)
    centre = [
        (patch.box[k] + each + 0.5) * factor - 0.5 + origin[k] for k, each in enumerate((u, v))
    ]
    moments = np.array([[uu, uv], [uv, vv]]) * factor**2
    return Ellipse(np.array(centre), moments), fit


def _judged(
    outline: Ellipse,
    fit: float,
    patch: _Patch,
    cut: bool,
    threshold: float,
    options: DetectorOptions,
) -> Candidate:
    major, minor = outline.semi_axes
    contrast = patch.inside - patch.outside
    reason = ''
    if contrast < threshold:
        reason = f'contrast {contrast:.2f} is below {threshold:.2f}'
    elif patch.inside < options.min_redness:
        reason = f'redness {patch.inside:.2f} is below {options.min_redness:.2f}'
    elif cut:
        reason = 'cut by the edge of the image'
    elif 2 * major < options.min_diameter:
        reason = f'diameter {2 * major:.1f} px is below {options.min_diameter:.1f} px'
    elif 2 * major > options.max_diameter:
        reason = f'diameter {2 * major:.1f} px is above {options.max_diameter:.1f} px'
    elif minor < options.min_axis_ratio * major:
        reason = f'axis ratio {minor / major:.2f} is below {options.min_axis_ratio:.2f}'
    elif fit < options.min_fit:
        reason = f'shape agrees with an ellipse by {fit:.2f}, less than {options.min_fit:.2f}'
    score = contrast * fit**4 * math.sqrt(major * minor)
    return Candidate(outline, contrast, patch.inside, fit, score, reason)


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
