"""The pixels about an outline."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .images import Frame
from .target import Ellipse

Grid = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]


class Window:
    """The pixels up to a margin around an outline, with coordinates from its centre.

    pixels is (rows, columns, 3) float32, x (columns,) and y (rows,) px. Raises DetectionError
    where the outline lies outside of the image.
    """

    def __init__(self, frame: Frame, around: Ellipse, margin: float) -> None:
        (a, _), (_, d) = around.moments.tolist()
        u, v = around.centre.tolist()
        across, down = 2 * math.sqrt(a) + margin, 2 * math.sqrt(d) + margin
        left, top = max(math.floor(u - across), 0), max(math.floor(v - down), 0)
        right = min(math.ceil(u + across) + 1, frame.width)
        bottom = min(math.ceil(v + down) + 1, frame.height)
        if right - left < 4 or bottom - top < 4:
            msg = 'the outline lies outside of the image'
            raise DetectionError(msg)
        self.pixels: Grid = frame.window(left, top, right, bottom).astype(np.float32)
        self.x: Grid = np.arange(left, right, dtype=np.float32) - np.float32(u)
        self.y: Grid = np.arange(top, bottom, dtype=np.float32) - np.float32(v)
        self._semi_axes = around.semi_axes
        angle = around.angle
        self._cosine, self._sine = math.cos(angle), math.sin(angle)

    def within(self, margin: float, scale: float = 1.0) -> Mask:
        """The pixels within the outline, its semi-axes times `scale` plus `margin` px."""
        major, minor = (axis * scale + margin for axis in self._semi_axes)
        if minor <= 0.5:
            return np.zeros((self.y.size, self.x.size), bool)
        along, across = 1 / major**2, 1 / minor**2
        c, s = self._cosine, self._sine
        a = np.float32(along * c * c + across * s * s)
        b = np.float32(2 * (along - across) * c * s)
        d = np.float32(along * s * s + across * c * c)
        x, y = self.x, self.y
        inside: Mask = a * (x * x) + np.outer(b * y, x) < (1 - d * (y * y))[:, None]
        return inside
