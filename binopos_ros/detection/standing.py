"""What stands still in the image while the water moves: something drawn over the picture.

A mark that a recorder draws, or dirt on the lens, keeps its place and its colour whatever goes on
about it. A target at rest before a camera at rest keeps its place too, but so do its surroundings;
and light that wanders over these wanders over it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from .describe import Description
from .target import Target

STILL = 0.1
"""px by which what stands still may seem to move, by the fit of its edge."""

AS_BEFORE = 1.0
"""Reduced pixels by which it may, by its outline alone."""

MOVED = 0.1
"""By which share of the patch's contrast its surroundings must change to count as moving, and by
which share of that change its own colour may change: what shows of them through its edge."""


class View(NamedTuple):
    """A followed patch in one image: its centre, px, and what it was described by."""

    centre: tuple[float, float]
    patch: Description


class Standing:
    """Watches a followed patch, a look at a time, and remembers where something stood still."""

    def __init__(self, looks: int) -> None:
        """Take how many looks in a row something must have stood still."""
        self._looks = looks
        self._view: View | None = None
        self._still = 0
        self._places: list[Description] = []

    def look(self, target: Target, patch: Description) -> None:
        """Compare a followed patch with the last look at it."""
        u, v = target.centre.tolist()
        view, last = View((u, v), patch), self._view
        self._view = view
        self._still = self._still + 1 if last is not None and _stood(last, view) else 0
        if self._still >= self._looks:
            self._places.append(patch)
            self.lost()

    def lost(self) -> None:
        """The patch is followed no longer."""
        self._view, self._still = None, 0

    def refusal(self, seen: Description) -> str:
        """Why a patch is none, if it is what stood still."""
        if not any(_is_as_before(each, seen) for each in self._places):
            return ''
        return 'stands still in the image while what is about it moves: drawn over the picture'


def _stood(last: View, view: View) -> bool:
    """Whether a patch kept its place and its colour while its surroundings changed."""
    before, now = last.patch, view.patch
    if math.dist(last.centre, view.centre) > STILL or _scale(before) != _scale(now):
        return False
    (x, y), (left, top) = _corner(before), _corner(now)
    x0, y0 = max(x, left), max(y, top)
    parts = [
        (each.cutout.pixels[y0 - v :, x0 - u :], each.cutout.outer[y0 - v :, x0 - u :])
        for each, (u, v) in ((before, (x, y)), (now, (left, top)))
    ]
    height, width = np.minimum(parts[0][1].shape, parts[1][1].shape)
    (pixels, outer), (later, outer_later) = (
        (p[:height, :width], o[:height, :width]) for p, o in parts
    )
    moved = sum(cv2.mean(cv2.absdiff(pixels, later), 1 - np.maximum(outer, outer_later))[:3])
    changed = _apart(before.cutout.inside, now.cutout.inside)
    contrast = _apart(now.cutout.inside, now.cutout.around)
    return moved > MOVED * contrast and changed < MOVED * moved


def _is_as_before(place: Description, seen: Description) -> bool:
    """Whether a patch is where something stood still, as large and of the same colour."""
    near = AS_BEFORE * max(_scale(place), _scale(seen))
    (u, v), (was_u, was_v) = seen.outline.centre.tolist(), place.outline.centre.tolist()
    inside, was_inside = seen.cutout.inside, place.cutout.inside
    return (
        math.dist((u, v), (was_u, was_v)) <= near
        and abs(seen.outline.semi_axes[0] - place.outline.semi_axes[0]) <= near
        and _apart(inside, was_inside) < MOVED * _apart(was_inside, place.cutout.around)
    )


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    return sum(abs(a - b) for a, b in zip(one, other, strict=True))


def _scale(patch: Description) -> int:
    return patch.sighting.factor


def _corner(patch: Description) -> tuple[int, int]:
    """Where a patch's cut-out begins, in reduced pixels of the image."""
    factor, (left, top) = _scale(patch), patch.sighting.origin
    column, row = patch.cutout.corner
    return left // factor + column, top // factor + row
