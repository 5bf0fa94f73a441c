"""The simulator's own lens: from a pixel back to the ray that made it.

Brown's model in the terms and signs of the paper's Eq. 1-2 as OpenCV writes them (k1, k2, p1, p2,
k3, then the rational denominator k4, k5, k6). This is a second, separate derivation of what
`binopos_ros.optics` does, and solves the inverse by Newton's method on the exact Jacobian:
pictures made here test the projection there.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.simulation.errors import SimulationError

Array = NDArray[np.float64]

MAX_ITERATIONS = 30
MAX_TERMS = 8


class Lens:
    """A pinhole with Brown distortion.

    Args:
        matrix: (3, 3) intrinsic matrix, px.
        distortion: 0 to 8 terms in OpenCV's order.
        size: (width, height), px.

    Raises:
        SimulationError: the distortion folds over inside the image, so that one pixel would see
            several directions.
    """

    def __init__(self, matrix: ArrayLike, distortion: ArrayLike, size: tuple[int, int]) -> None:
        self.matrix = np.asarray(matrix, float)
        terms = np.asarray(distortion, float).ravel()
        if terms.size > MAX_TERMS and np.any(terms[MAX_TERMS:]):
            msg = f'distortion has {terms.size} terms: the simulator knows the first {MAX_TERMS}'
            raise SimulationError(msg)
        self.terms = np.zeros(MAX_TERMS)
        self.terms[: min(terms.size, MAX_TERMS)] = terms[:MAX_TERMS]
        self.size = (int(size[0]), int(size[1]))
        self._refuse_folds()

    def directions(self, pixels: ArrayLike) -> Array:
        """(N, 2) pixels to (N, 3) unit directions in the camera's frame."""
        pixels = np.asarray(pixels, float)
        yd = (pixels[:, 1] - self.matrix[1, 2]) / self.matrix[1, 1]
        xd = (pixels[:, 0] - self.matrix[0, 2] - self.matrix[0, 1] * yd) / self.matrix[0, 0]
        x, y = xd.copy(), yd.copy()
        for _ in range(MAX_ITERATIONS):
            fx, fy, jxx, jxy, jyx, jyy = self._distort(x, y)
            ex, ey = xd - fx, yd - fy
            determinant = jxx * jyy - jxy * jyx
            dx = (jyy * ex - jxy * ey) / determinant
            dy = (jxx * ey - jyx * ex) / determinant
            x += dx
            y += dy
            if max(np.max(np.abs(dx), initial=0.0), np.max(np.abs(dy), initial=0.0)) < 1e-13:
                break
        else:
            msg = 'the lens distortion has no inverse at some pixels: use smaller terms'
            raise SimulationError(msg)
        norm = np.sqrt(x * x + y * y + 1)
        return np.stack([x / norm, y / norm, 1 / norm], axis=1)

    def pixels(self, directions: ArrayLike) -> Array:
        """(N, 3) directions with z > 0 to (N, 2) pixels."""
        directions = np.asarray(directions, float)
        x, y, *_ = self._distort(
            directions[:, 0] / directions[:, 2], directions[:, 1] / directions[:, 2]
        )
        return np.stack(
            [
                self.matrix[0, 0] * x + self.matrix[0, 1] * y + self.matrix[0, 2],
                self.matrix[1, 1] * y + self.matrix[1, 2],
            ],
            axis=1,
        )

    def _distort(self, x: Array, y: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Distorted coordinates and their Jacobian (xx, xy, yx, yy) at ideal coordinates."""
        k1, k2, p1, p2, k3, k4, k5, k6 = self.terms
        r2 = x * x + y * y
        above = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        below = 1 + r2 * (k4 + r2 * (k5 + r2 * k6))
        radial = above / below
        # Derivative by r^2.
        slope = (
            k1 + r2 * (2 * k2 + 3 * r2 * k3) - radial * (k4 + r2 * (2 * k5 + 3 * r2 * k6))
        ) / below
        xd = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        cross = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
        return (
            xd,
            yd,
            radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x,
            cross,
            cross,
            radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x,
        )

    def _refuse_folds(self) -> None:
        width, height = self.size
        u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 41), np.linspace(-0.5, height - 0.5, 31))
        pixels = np.column_stack([u.ravel(), v.ravel()])
        msg = (
            f'the distortion {self.terms.tolist()} folds over inside the image of '
            f'{width}x{height}: use smaller terms or a longer focal length'
        )
        with np.errstate(all='ignore'):
            try:
                rays = self.directions(pixels)
            except SimulationError:
                raise SimulationError(msg) from None
        x, y = rays[:, 0] / rays[:, 2], rays[:, 1] / rays[:, 2]
        # Along the way from the centre out to each border pixel the map must keep its orientation.
        for share in np.linspace(0.05, 1, 20):
            _, _, jxx, jxy, jyx, jyy = self._distort(share * x, share * y)
            if not np.all(jxx * jyy - jxy * jyx > 0) or not np.all(np.isfinite(rays)):
                raise SimulationError(msg)
