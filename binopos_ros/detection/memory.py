"""What a camera's past images tell: where the target is, how large it is, and what is new.

One image cannot tell a target from what looks like it for a moment, such as the sun in a wave.
Over images a target keeps its size, and stays; a patch that is neither where nor as large as the
target was is new, and must be seen in several images in a row before it is believed. The very
first image has no past, so what it shows is believed at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from .describe import Description
from .judge import Judged, refused
from .target import Target

LASTING = 3
"""Images in a row in which a new patch must be seen."""

GROWTH = 1.5
"""Largest factor between the diameters of a target in two images: its distance changes by less."""

LEAP = 0.1
"""Share of the image's longer side that a target may go from one image to the next."""


class Newcomer(NamedTuple):
    """A patch that is not known yet, and in how many images in a row it was seen."""

    patch: Description
    images: int


class Memory:
    """What is known of the target after the images so far."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Know nothing, as before the first image."""
        self.last: Target | None = None
        self.motion = 0.0, 0.0
        self._diameter: float | None = None
        self._is_first = True
        self._newcomers: list[Newcomer] = []

    def remember(self, target: Target | None) -> None:
        """Take in what an image showed."""
        self._is_first = False
        if target is None:
            self.last, self.motion = None, (0.0, 0.0)
            return
        if self.last is not None:
            (u, v), (last_u, last_v) = target.centre.tolist(), self.last.centre.tolist()
            self.motion = u - last_u, v - last_v
        self.last, self._diameter = target, target.diameter
        self._newcomers = []

    def followed(self, judged: Sequence[Judged]) -> list[Judged]:
        """Refuse what cannot be the target that was followed so far, for its size."""
        return refused(judged, self._other_size)

    def found(self, judged: Sequence[Judged], longer_side: int) -> list[Judged]:
        """Refuse what is new in a whole image, until it has lasted; longer_side in px."""
        if self._is_first:
            return list(judged)
        newcomers: list[Newcomer] = []

        def new(seen: Description) -> str:
            if self._diameter is not None and not self._other_size(seen):
                return ''
            images = 1 + self._images_of(seen, LEAP * longer_side)
            newcomers.append(Newcomer(seen, images))
            if images >= LASTING:
                return ''
            return f'new: seen in {images} of {LASTING} images in a row so far, as a glint may be'

        kept = refused(judged, new)
        self._newcomers = newcomers
        return kept

    def _other_size(self, seen: Description) -> str:
        expected, diameter = self._diameter, 2 * seen.outline.semi_axes[0]
        if expected is None or 1 / GROWTH <= diameter / expected <= GROWTH:
            return ''
        return f'diameter {diameter:.1f} px where the target had {expected:.1f} px'

    def _images_of(self, seen: Description, reach: float) -> int:
        """In how many images in a row until the last one a patch was seen."""
        (u, v), diameter = seen.outline.centre.tolist(), 2 * seen.outline.semi_axes[0]
        return max(
            (
                each.images
                for each in self._newcomers
                if math.dist((u, v), each.patch.outline.centre.tolist()) < max(diameter, reach)
                and 1 / GROWTH <= diameter / (2 * each.patch.outline.semi_axes[0]) <= GROWTH
            ),
            default=0,
        )
