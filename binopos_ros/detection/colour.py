"""Two chromatic quantities: redness, and what tells red from yellow and from violet.

Redness is (R - G) / (R + G + B + c), yellowness (G - B) / (R + G + B + c): brightness cancels. The
constant keeps the noise of dark pixels small.

Water takes red first, which lowers the redness of target and surroundings alike, so a patch is
judged by its contrast to what surrounds it. It also mixes its own colour into whatever is seen
through it, so a faded colour lies on the line from the water's to its own. Where that line is as
red as can be (redness 1) lies 0 yellowness for a red paint, more for an orange or a yellow one,
less for a pink or a violet one, however much of it the water has taken.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from .images import Picture

Map = npt.NDArray[np.float32]

DARK, FULL = 24.0, 255.0


def redness(bgr: Picture) -> Map:
    """Give (R - G) / (R + G + B + 24), (height, width) float32, of blue-green-red pixels."""
    blue, green, red = cv2.split(bgr)
    numerator = cv2.subtract(red, green, dtype=cv2.CV_32F)
    total = cv2.add(cv2.add(blue, green, dtype=cv2.CV_32F), red, dtype=cv2.CV_32F)
    return np.asarray(numerator / (total + np.float32(DARK)), np.float32)


def redness_of(colour: Sequence[float]) -> float:
    """Give the redness of one colour, blue, green, red."""
    return _chroma(colour)[0]


class Hue(NamedTuple):
    """A patch's colour beside that of its surroundings.

    purity is the share in which it has gone from theirs to a full red, by redness; tint the
    yellowness (below 0: the violet) that it would have there.
    """

    purity: float
    tint: float


def hue(inside: Sequence[float], around: Sequence[float]) -> Hue:
    """Give the hue of a colour among another, each blue, green, red."""
    (redder, yellower), (red, yellow) = _chroma(inside), _chroma(around)
    purity = (redder - red) / (1 - red)
    if purity <= 0:
        return Hue(0.0, 0.0)
    return Hue(purity, yellow + (yellower - yellow) / purity)


def fullest(inside: Sequence[float], around: Sequence[float]) -> tuple[float, float, float]:
    """Carry a colour on from its surroundings' until a channel is full or empty.

    Both are blue, green, red. Whatever share of a pixel or of the way through the water a thing
    takes, and however small it is, what it adds to its surroundings leads to its own colour at
    its fullest: white for a glint, red for a red that is faded. Gives the surroundings' where the
    two are the same.
    """
    blue, green, red = (
        math.inf if a == b else ((FULL if a > b else 0.0) - b) / (a - b)
        for a, b in zip(inside[:3], around[:3], strict=True)
    )
    reach = min(blue, green, red)
    if math.isinf(reach):
        reach = 1.0
    blue, green, red = (b + reach * (a - b) for a, b in zip(inside[:3], around[:3], strict=True))
    return blue, green, red


def _chroma(colour: Sequence[float]) -> tuple[float, float]:
    blue, green, red = colour[:3]
    total = blue + green + red + DARK
    return (red - green) / total, (green - blue) / total
