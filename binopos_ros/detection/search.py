"""Find or follow: red patches, seen in a reduced picture.

A patch is found in a picture that is small enough to be quick, and outlined at a scale where it is
large enough to show its shape.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from . import moments
from .colour import Map, redness
from .images import Frame, Picture
from .options import DetectorOptions
from .patches import (
    Patch,
    frame_of,
    median,
    noise_by_place,
    noise_of,
    outlined,
    reaches_over,
    seeds,
    settled_about,
)

SEARCH_WIDTH = 320
SHAPE_SIZE, SHAPE_WIDTH = 8, 5
"""Reduced pixels that a patch must have across to show its shape: the longer side, and the mean
width across that."""

LEAST_SIDE = 3
LEAST_NOISY = 32
"""Reduced pixels that a side must have for a noisy frame to be reduced further."""


class Sighting(NamedTuple):
    """A patch, and the reduced pixels that it was outlined in.

    factor is by how much they are reduced, origin their corner in the image, px, threshold the
    contrast that is asked of a target at that place.
    """

    patch: Patch
    pixels: Picture
    factor: int
    origin: tuple[int, int]
    threshold: float


class Sightings(NamedTuple):
    """What stands out in a frame, the contrast that is asked for in most of it, and the scale.

    factor is that by which the frame was reduced to be searched.
    """

    each: list[Sighting]
    threshold: float
    factor: int


def find(frame: Frame, options: DetectorOptions) -> Sightings:
    """Find the red patches in a frame, the strongest first; one may come more than once."""
    factor = _search_factor(frame)
    pixels, shades, asked = _seen(frame, factor, options)
    threshold = median(asked.copy())
    if threshold > options.min_contrast and min(frame.width, frame.height) >= LEAST_NOISY * factor:
        # Pixels too noisy to tell by: what is dim may still show in the means over four of them.
        factor *= 2
        pixels, shades, asked = _seen(frame, factor, options)
        threshold = median(asked.copy())
    if min(shades.shape) < LEAST_SIDE:
        return Sightings([], threshold, factor)
    found = []
    height, width = shades.shape
    thresholds = np.asarray(cv2.resize(asked, (width, height)), np.float32)
    for column, row, size in seeds(shades, thresholds):
        patch = outlined(shades, column, row, size)
        if patch is not None:
            x0, y0, x1, y1 = patch.near(moments.margin(factor))
            there = _asked(shades[max(y0, 0) : y1, max(x0, 0) : x1], options)
            found.append(_at_its_scale(frame, Sighting(patch, pixels, factor, (0, 0), there)))
    return Sightings([each for each in found if each is not None], threshold, factor)


def follow(
    frame: Frame,
    place: tuple[float, float],
    diameter: float,
    slack: float,
    factor: int,
    options: DetectorOptions,
) -> Sightings:
    """Find the patch at a place, px, or within `slack` px of it, at the scale of a search.

    Where the patch is the one that `find` would find, its outline is the same to the last digit:
    the blocks are the same, and a patch that the window does not show with all that it is judged
    by is none.
    """
    # As much as is looked at about a patch of that diameter.
    margin = max(diameter / 8 + 3 * factor, moments.margin(factor) * factor)
    reach = diameter / 2 + margin + factor + max(slack, 2 * factor)
    u, v = place
    x0, y0 = (max(int((each - reach) // factor), 0) for each in place)
    x1 = min(int((u + reach) // factor) + 1, frame.width // factor)
    y1 = min(int((v + reach) // factor) + 1, frame.height // factor)
    if min(x1 - x0, y1 - y0) < LEAST_SIDE:
        return Sightings([], options.min_contrast, factor)
    pixels = frame.reduced(factor, x0 * factor, y0 * factor, x1 * factor, y1 * factor)
    shades = redness(pixels)
    threshold = _asked(shades, options)
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
        return Sightings([], threshold, factor)
    seen = _at_its_scale(
        frame, Sighting(patch, pixels, factor, (x0 * factor, y0 * factor), threshold)
    )
    return Sightings([] if seen is None else [seen], threshold, factor)


def _search_factor(frame: Frame) -> int:
    """The factor by which a frame is reduced to be searched: 1 or even."""
    factor = 1
    shorter, longer = sorted((frame.width, frame.height))
    while longer / factor > SEARCH_WIDTH * 1.5 and shorter / factor >= 2 * LEAST_SIDE:
        factor *= 2
    return factor


def _seen(frame: Frame, factor: int, options: DetectorOptions) -> tuple[Picture, Map, Map]:
    """A frame reduced by a factor, its redness, and the contrast asked for in its places."""
    pixels = frame.reduced(factor, 0, 0, frame.width, frame.height)
    shades = redness(pixels)
    asked = np.float32(options.noise_factor) * noise_by_place(shades)
    return pixels, shades, np.maximum(asked, np.float32(options.min_contrast))


def _asked(shades: Map, options: DetectorOptions) -> float:
    """The contrast asked of a target where the redness is that."""
    return max(options.min_contrast, options.noise_factor * noise_of(shades))


def _at_its_scale(frame: Frame, seen: Sighting) -> Sighting | None:
    """The patch of a sighting, outlined anew where it is too small to show its shape."""
    patch, _, factor, (left, top), threshold = seen
    x0, y0, x1, y1 = patch.box
    size = max(x1 - x0, y1 - y0)
    needed = max(SHAPE_SIZE / size, SHAPE_WIDTH * size / cv2.countNonZero(patch.mask))
    finer = factor
    while finer > 1 and factor / finer < needed:
        finer //= 2
    if finer == factor:
        return seen
    margin = size // 2 + 4
    wide = (
        max((x0 - margin) * factor + left, 0),
        max((y0 - margin) * factor + top, 0),
        min((x1 + margin) * factor + left, frame.width),
        min((y1 + margin) * factor + top, frame.height),
    )
    pixels = frame.reduced(finer, *wide)
    shades = np.asarray(cv2.blur(redness(pixels), (3, 3)), np.float32)
    rows, columns = np.nonzero(patch.mask)
    k = int(np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2))
    column = ((x0 + columns[k] + 0.5) * factor + left - wide[0]) / finer
    row = ((y0 + rows[k] + 0.5) * factor + top - wide[1]) / finer
    column = min(int(column), shades.shape[1] - 1)
    row = min(int(row), shades.shape[0] - 1)
    settled = settled_about(shades, column, row, patch.inside, patch.outside)
    return None if settled is None else Sighting(settled, pixels, finer, wide[:2], threshold)
