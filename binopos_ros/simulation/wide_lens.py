"""The simulator's own wide lens: from a pixel back to the ray that made it, by its angle.

The equidistant model of Kannala and Brandt in four terms, as OpenCV's fisheye has it. As `lens.py`
this is a derivation of its own: it works on angles, where `binopos_ros.optics` works on the image
plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.simulation.errors import SimulationError

Array = NDArray[np.float64]

TERMS = 4
#: Halvings of a right angle until Newton's method cannot miss, and its steps to the last digit.
HALVINGS, STEPS = 7, 4


class WideLens:
    """A lens of equidistant projection.

    Args:
        matrix: (3, 3) intrinsic matrix, px.
        distortion: k1 to k4.
        size: (width, height), px.

    Raises:
        SimulationError: the image shows more than 90 degrees off the axis, or folds over.
    """

    def __init__(self, matrix: ArrayLike, distortion: ArrayLike, size: tuple[int, int]) -> None:
        self.matrix = np.asarray(matrix, float)
        self.terms = np.asarray(distortion, float).ravel()
        self.size = (int(size[0]), int(size[1]))
        width, height = self.size
        corners = [(u - 0.5, v - 0.5) for u in (0, width) for v in (0, height)]
        farthest = float(np.max(np.hypot(*self._plane(np.array(corners)))))
        angles = np.linspace(0.0, np.pi / 2, 1000)
        images, _ = self._image(angles)
        rising = np.argmax(np.append(np.diff(images) <= 0, True)) + 1
        if images[:rising].max() <= farthest:
            what = 'shows more than 90 degrees off the axis' if rising == 1000 else 'folds over'
            msg = (
                f'the image of {width}x{height} {what} with the terms {self.terms.tolist()}: use '
                'a longer focal length'
            )
            raise SimulationError(msg)
        self._widest = angles[rising - 1]

    def directions(self, pixels: ArrayLike) -> Array:
        """(N, 2) pixels to (N, 3) unit directions in the camera's frame."""
        x, y = self._plane(np.asarray(pixels, float))
        wanted = np.hypot(x, y)
        low, high = np.zeros_like(wanted), np.full_like(wanted, self._widest)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            short = self._image(middle)[0] < wanted
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        angle = 0.5 * (low + high)
        for _ in range(STEPS):
            image, slope = self._image(angle)
            angle = np.clip(angle - (image - wanted) / slope, 0.0, self._widest)
        across = np.sin(angle) / np.where(wanted > 0, wanted, 1.0)
        return np.stack([x * across, y * across, np.cos(angle)], axis=1)

    def pixels(self, directions: ArrayLike) -> Array:
        """(N, 3) directions with z > 0 to (N, 2) pixels."""
        directions = np.asarray(directions, float)
        across = np.hypot(directions[:, 0], directions[:, 1])
        image, _ = self._image(np.arctan2(across, directions[:, 2]))
        scale = image / np.where(across > 0, across, 1.0)
        x, y = directions[:, 0] * scale, directions[:, 1] * scale
        return np.stack(
            [
                self.matrix[0, 0] * x + self.matrix[0, 1] * y + self.matrix[0, 2],
                self.matrix[1, 1] * y + self.matrix[1, 2],
            ],
            axis=1,
        )

    def _plane(self, pixels: Array) -> tuple[Array, Array]:
        y = (pixels[:, 1] - self.matrix[1, 2]) / self.matrix[1, 1]
        return (pixels[:, 0] - self.matrix[0, 2] - self.matrix[0, 1] * y) / self.matrix[0, 0], y

    def _image(self, angle: Array) -> tuple[Array, Array]:
        """How far from the principal point a ray comes to lie, in focal lengths, and its slope."""
        square = angle * angle
        image, slope = np.zeros_like(angle), np.zeros_like(angle)
        for power in range(TERMS, 0, -1):
            term = self.terms[power - 1]
            image, slope = square * (image + term), square * (slope + (2 * power + 1) * term)
        return angle * (1 + image), 1 + slope
