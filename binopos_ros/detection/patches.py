"""Red patches in a map of redness: where they stand out, and how far each of them goes.

A patch is first seen where the redness of a square stands out from that of the frame around it,
at one of several sizes an octave apart. It is then outlined half-way between its own redness and
its surroundings'.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .colour import Map

Window = tuple[int, int, int, int]

MAX_SEEDS = 16
FIRST_CUT, MOST_CUTS = 0.35, 8
NOISE_STEP = 3
PLACE = 7
"""Values of the noise, that many pixels apart, along each side of a place."""

NEIGHBOURS = np.ones((3, 3), np.uint8)


class Patch(NamedTuple):
    """A patch in pixels of a reduced map."""

    box: Window
    mask: npt.NDArray[np.uint8]
    inside: float
    outside: float

    def near(self, least: int = 0) -> Window:
        """The part of the map that the patch is judged by, at least so far about it."""
        x0, y0, x1, y1 = self.box
        margin = max(_margin(x1 - x0, y1 - y0), least)
        return x0 - margin, y0 - margin, x1 + margin, y1 + margin

    def moved(self, column: int, row: int) -> Patch:
        """The same patch in a map whose corner lies so much farther to the upper left."""
        x0, y0, x1, y1 = self.box
        return self._replace(box=(x0 + column, y0 + row, x1 + column, y1 + row))


def _margin(width: int, height: int) -> int:
    """How far about a patch its surroundings are looked at."""
    return 3 + max(width, height) // 8


def noise_of(shades: Map) -> float:
    """The noise of redness, as a standard deviation."""
    rest = (shades - cv2.blur(shades, (3, 3)))[::NOISE_STEP, ::NOISE_STEP]
    return 1.5 * median(np.abs(rest))


def noise_by_place(shades: Map) -> Map:
    """The noise of redness in the places of a map, (rows, columns), as a standard deviation.

    Redness is a ratio, so it is noisier where the picture is dark.
    """
    rest = np.abs(shades - cv2.blur(shades, (3, 3)))[::NOISE_STEP, ::NOISE_STEP]
    high, wide = (min(PLACE, each) for each in rest.shape)
    rows, columns = rest.shape[0] // high, rest.shape[1] // wide
    places = rest[: rows * high, : columns * wide].reshape(rows, high, columns, wide)
    values = places.swapaxes(1, 2).reshape(rows, columns, -1)
    middle = values.shape[2] // 2
    values.partition(middle, axis=2)
    noise: Map = values[..., middle] * np.float32(1.5)
    return noise


def median(values: Map) -> float:
    """The median; of an even number of values, the upper of the middle two."""
    flat, middle = values.ravel(), values.size // 2
    flat.partition(middle)
    return float(flat[middle])


def seeds(shades: Map, thresholds: Map) -> list[tuple[int, int, int]]:
    """Where the redness stands out: column, row and the size of the square, strongest first.

    thresholds is the contrast asked for at each pixel, by which it is measured.
    """
    contrasts: list[Map] = []
    means = shades
    sizes = [1]
    while sizes[-1] < min(shades.shape) / 2:
        inner, size = sizes[-1], sizes[-1] * 2 + 1
        wider = cv2.blur(shades, (size, size), borderType=cv2.BORDER_REFLECT)
        contrast = np.subtract(means, wider)
        contrast *= np.float32(size**2 / (size**2 - inner**2))
        contrasts.append(contrast)
        sizes.append(size)
        means = np.asarray(wider, np.float32)
    best = contrasts[0]
    for each in contrasts[1:]:
        best = np.asarray(cv2.max(best, each), np.float32)
    best = np.divide(best, thresholds)
    peaks = (best >= cv2.dilate(best, NEIGHBOURS)) & (best > 0.75)
    rows, columns = np.nonzero(peaks)
    scales = np.argmax([each[rows, columns] for each in contrasts], axis=0)
    order = np.argsort(-best[rows, columns], kind='stable')[:MAX_SEEDS]
    return [(int(columns[k]), int(rows[k]), sizes[scales[k]]) for k in order]


def outlined(shades: Map, column: int, row: int, size: int) -> Patch | None:
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
        inside, outside = cv2.mean(square)[0], median(frame_of(part))
        patch = settled_about(part, column - x0, row - y0, inside, outside)
        if patch is None:
            return None
        patch = patch.moved(x0, y0)
        if not reaches_over(patch.near(), (x0, y0, x1, y1), whole):
            return patch
        half *= 2
    return None


def reaches_over(near: Window, part: Window, whole: Window) -> bool:
    """Whether a part of the whole shows less of it than what is near."""
    return (
        max(near[0], whole[0]) < part[0]
        or max(near[1], whole[1]) < part[1]
        or min(near[2], whole[2]) > part[2]
        or min(near[3], whole[3]) > part[3]
    )


def settled_about(part: Map, column: int, row: int, inside: float, outside: float) -> Patch | None:
    """Cut, take the means on both sides, and cut again until the patch stays as it is.

    Where it ends depends on the pixels near the patch alone: the first cut is low, so the patch
    shrinks to the largest that agrees with its own means, whatever the levels at the start.
    """
    area, patch = 0, None
    level = outside + FIRST_CUT * (inside - outside)
    for _ in range(MOST_CUTS):
        above = (part > level).view(np.uint8)
        if not above[row, column]:
            return None
        size, *_, (x, y, w, h) = cv2.floodFill(above, None, (column, row), 2)
        # A patch lies within the one that is cut lower, so the same size is the same patch.
        if size == area:
            break
        area = size
        margin = _margin(w, h)
        left, top = max(x - margin, 0), max(y - margin, 0)
        near = slice(top, y + h + margin), slice(left, x + w + margin)
        seen = part[near]
        mask = (above[near] == 2).view(np.uint8)
        around = seen[cv2.dilate(mask, NEIGHBOURS) == 0]
        if around.size < 4:
            return None
        core = cv2.erode(mask, NEIGHBOURS, borderValue=0)
        inside = cv2.mean(seen, core if cv2.countNonZero(core) else mask)[0]
        outside = median(around)
        level = (inside + outside) / 2
        inner = mask[y - top : y - top + h, x - left : x - left + w]
        patch = Patch((x, y, x + w, y + h), inner, inside, outside)
    return patch


def frame_of(part: Map) -> Map:
    """The pixels along the four sides."""
    return np.concatenate([part[0], part[-1], part[1:-1, 0], part[1:-1, -1]])
