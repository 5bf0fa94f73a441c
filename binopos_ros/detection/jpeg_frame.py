"""A JPEG of which only what is looked at is decoded.

Its pixels are those of the whole picture, so nothing that is computed of them depends on how much
was decoded. What is not looked at is not checked either: faults of the data
farther down stay unseen.
"""

from __future__ import annotations

import numpy as np

from .decoders import Octets, decode_box
from .errors import UnreadableError
from .frames import ColourFrame, Picture
from .jpeg import JpegHeader

Box = tuple[int, int, int, int]

LEAST_MARGIN = 32
"""px that are decoded about a window, or half of the longer side: what comes next is near."""


class JpegFrame:
    """A frame out of a JPEG's data, which must stay as they are while it is in use."""

    def __init__(self, octets: Octets, header: JpegHeader) -> None:
        self.width, self.height, self.rounding = header.width, header.height, header.rounding
        self._octets = octets
        self._take((0, 0, 0, 0), np.empty((0, 0, 3), np.uint8))

    def foresee(self, box: Box | None) -> None:
        """Decode a box ahead, or without one the whole picture.

        Where that fails nothing is said: it is not known yet whether all of it is needed.
        """
        whole = 0, 0, self.width, self.height
        ahead = whole if box is None else self._within(box)
        if ahead[0] < ahead[2] and ahead[1] < ahead[3]:
            try:
                self._decode(ahead)
            except UnreadableError:
                return

    def window(self, x0: int, y0: int, x1: int, y1: int) -> Picture:
        self._show((x0, y0, x1, y1))
        left, top = self._box[:2]
        return self._part.window(x0 - left, y0 - top, x1 - left, y1 - top)

    def reduced(self, factor: int, x0: int, y0: int, x1: int, y1: int) -> Picture:
        self._show((x0, y0, x1, y1))
        left, top = self._box[:2]
        return self._part.reduced(factor, x0 - left, y0 - top, x1 - left, y1 - top)

    def _show(self, wanted: Box) -> None:
        """Have at least what is wanted of the picture decoded.

        Raises UnreadableError where the data down to there is corrupt.
        """
        x0, y0, x1, y1 = wanted
        left, top, right, bottom = self._box
        if left <= x0 and top <= y0 and x1 <= right and y1 <= bottom:
            return
        margin = max(max(x1 - x0, y1 - y0) // 2, LEAST_MARGIN)
        try:
            self._decode(self._within((x0 - margin, y0 - margin, x1 + margin, y1 + margin)))
        except UnreadableError:
            # Whether a picture can be used must not depend on how much more was asked for.
            self._decode(wanted)

    def _decode(self, box: Box) -> None:
        self._take(box, decode_box(self._octets, (self.width, self.height), box))

    def _take(self, box: Box, pixels: Picture) -> None:
        self._box, self._part = box, ColourFrame(pixels)

    def _within(self, box: Box) -> Box:
        x0, y0, x1, y1 = box
        return max(x0, 0), max(y0, 0), min(x1, self.width), min(y1, self.height)
