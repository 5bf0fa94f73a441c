"""What both cameras see of one rigid thing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class View:
    """One board (or rigid target) as both cameras see it.

    Attributes:
        name: what the user calls it (the file's or message's name).
        points: (N, 3) in the board frame (m).
        pixels: per camera (N, 2), nan where that camera does not see the point; one coordinate
            alone may be nan as well.
        turns: whether the orientation is unknown; a ball has none.
    """

    name: str
    points: np.ndarray
    pixels: tuple[np.ndarray, ...]
    turns: bool = True
