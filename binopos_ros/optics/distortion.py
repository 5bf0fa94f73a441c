"""The Brown lens (Eq. 1-2 of the paper) in OpenCV's full family of terms, forwards and backwards.

Coefficients stand in OpenCV's order: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]], so 0, 4,
5, 8, 12 or 14 of them. Image-plane coordinates are (x, y) = (X / Z, Y / Z). The formulas are
D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971), extended by
the rational radial part, the thin prism and the tilted sensor as OpenCV documents them.

Every kernel works on components, so the same lines serve arrays and plain floats.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import ARRAYS, Arithmetic, Component
from binopos_ros.optics.errors import OpticsError

TERMS = (0, 4, 5, 8, 12, 14)
NEWTON_LIMIT = 60
TINY = 1e-300
OUT_OF_FIELD = "beyond the lens's field (its distortion folds over)"


class Distortion:
    """A lens's distortion on the image plane (see `lens.Lens`).

    Args:
        coefficients: 0, 4, 5, 8, 12 or 14 OpenCV terms; the two tilts in radians.

    Raises:
        OpticsError: another number of terms, or one that is not finite.

    """

    model = 'brown'
    behind = 'behind the camera'

    def __init__(self, coefficients: ArrayLike) -> None:
        terms = np.array(coefficients, dtype=float).ravel()
        if terms.size not in TERMS:
            msg = f'distortion has {terms.size} terms; give 0, 4, 5, 8, 12 or 14 (OpenCV order)'
            raise OpticsError(msg)
        if not np.isfinite(terms).all():
            msg = f'distortion holds a number that is not finite: {terms.tolist()}'
            raise OpticsError(msg)
        terms.flags.writeable = False
        self.coefficients: NDArray[np.float64] = terms
        full = [*terms.tolist(), *[0.0] * (14 - terms.size)]
        self._radial = (full[0], full[1], full[4])
        self._tangential = (full[2], full[3])
        self._rational = tuple(full[5:8])
        self._prism = tuple(full[8:12])
        self._tilt = _tilt_homography(full[12], full[13]) if any(full[12:]) else None
        self._untilt = None if self._tilt is None else np.linalg.inv(self._tilt)
        self.is_identity = not any(full)
        self.fold_radius_squared = _fold(self._radial, self._rational)

    def distort(
        self, x: Component, y: Component, _: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Move ideal image-plane coordinates to where the lens puts them (Eq. 1-2)."""
        if self.is_identity:
            return x, y
        xd, yd = self._lens(x, y)[:2]
        if self._tilt is not None:
            xd, yd = _homography(self._tilt, xd, yd)[:2]
        return xd, yd

    def distort_with_jacobian(
        self, x: Component, y: Component, _: Arithmetic = ARRAYS
    ) -> tuple[Component, Component, Component, Component, Component, Component]:
        """Return xd, yd, and d(xd)/dx, d(xd)/dy, d(yd)/dx, d(yd)/dy."""
        if self.is_identity:
            return x, y, 1.0, 0.0, 0.0, 1.0
        xd, yd, a, b, c, d = self._lens(x, y)
        if self._tilt is not None:
            xd, yd, e, f, g, h = _homography(self._tilt, xd, yd)
            a, b, c, d = e * a + f * c, e * b + f * d, g * a + h * c, g * b + h * d
        return xd, yd, a, b, c, d

    def within_fold(self, x: Component, y: Component) -> Component:
        """Tell where the lens is one-to-one: inside the radius where its image turns back."""
        return x * x + y * y < self.fold_radius_squared

    def _lens(
        self, x: Component, y: Component
    ) -> tuple[Component, Component, Component, Component, Component, Component]:
        k1, k2, k3 = self._radial
        p1, p2 = self._tangential
        r2 = x * x + y * y
        gain = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3))  # d gain / d r2
        if any(self._rational):
            k4, k5, k6 = self._rational
            below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6))
            gain = gain / below
            slope = (slope - gain * (k4 + r2 * (2.0 * k5 + r2 * (3.0 * k6)))) / below
        xy = x * y
        xd = x * gain + 2.0 * p1 * xy + p2 * (r2 + 2.0 * x * x)
        yd = y * gain + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * xy
        cross = 2.0 * xy * slope + 2.0 * p1 * x + 2.0 * p2 * y
        xx = gain + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        yy = gain + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        if not any(self._prism):
            return xd, yd, xx, cross, cross, yy
        s1, s2, s3, s4 = self._prism
        first, second = 2.0 * (s1 + 2.0 * s2 * r2), 2.0 * (s3 + 2.0 * s4 * r2)
        xd = xd + r2 * (s1 + s2 * r2)
        yd = yd + r2 * (s3 + s4 * r2)
        return xd, yd, xx + x * first, cross + y * first, cross + x * second, yy + y * second

    def undistort(
        self, xd: Component, yd: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Invert `distort` by Newton's method to rounding; nan where nothing images there."""
        if self.is_identity:
            return xd, yd
        if self._untilt is not None:
            xd, yd = _homography(self._untilt, xd, yd)[:2]
        return self._undistort_lens(xd, yd, arithmetic)

    def _undistort_lens(
        self, xd: Component, yd: Component, arithmetic: Arithmetic
    ) -> tuple[Component, Component]:
        sqrt, maximum, minimum = arithmetic.sqrt, arithmetic.maximum, arithmetic.minimum
        any_, keep = arithmetic.any, arithmetic.keep
        limit = self.fold_radius_squared
        x, y, error = xd, yd, math.inf
        if math.isfinite(limit):
            shrink = sqrt(minimum(1.0, 0.8 * limit / maximum(xd * xd + yd * yd, TINY)))
            x, y = xd * shrink, yd * shrink
        for _ in range(NEWTON_LIMIT):
            fx, fy, a, b, c, d = self._lens(x, y)
            fx, fy = xd - fx, yd - fy
            error = abs(fx) + abs(fy)
            determinant = a * d - b * c
            dx, dy = (d * fx - b * fy) / determinant, (a * fy - c * fx) / determinant
            if math.isfinite(limit):
                # At most halfway to the fold: beyond it lies a second, false solution.
                room = 0.5 * (math.sqrt(limit) - sqrt(x * x + y * y))
                scale = minimum(1.0, room / (sqrt(dx * dx + dy * dy) + TINY))
                dx, dy = dx * scale, dy * scale
            x, y = x + dx, y + dy
            # The error falls with the square of the step, so a small step was the last.
            if not any_(abs(dx) + abs(dy) > 1e-9):
                break
        good = error <= 1e-7
        return keep(x, good, OUT_OF_FIELD), keep(y, good, OUT_OF_FIELD)


def _fold(radial: tuple[float, ...], rational: tuple[float, ...]) -> float:
    """Return the smallest r^2 > 0 at which d(r N / D)/dr vanishes or D does; inf if none.

    Both polynomials begin with 1, so the reversed ones are monic: their roots 1 / r^2 are stable
    however small the higher terms are.
    """
    numerator, below = np.array([1.0, *radial]), np.array([1.0, *rational])
    turning = np.convolve(numerator, below)
    # r^2 times the derivative of a polynomial of r^2 by it: each term by its power.
    turning += 2.0 * np.convolve(np.arange(numerator.size) * numerator, below)
    turning -= 2.0 * np.convolve(numerator, np.arange(below.size) * below)
    roots = np.concatenate([np.roots(turning), np.roots(below)])
    real = roots[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real
    return 1.0 / float(real.max()) if real.size else math.inf


def _tilt_homography(tau_x: float, tau_y: float) -> NDArray[Any]:
    cx, sx, cy, sy = math.cos(tau_x), math.sin(tau_x), math.cos(tau_y), math.sin(tau_y)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]])
    about_y = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]])
    rotation = about_y @ about_x
    onto_sensor = np.array(
        [[rotation[2, 2], 0.0, -rotation[0, 2]], [0.0, rotation[2, 2], -rotation[1, 2]], [0, 0, 1]]
    )
    return onto_sensor @ rotation


def _homography(
    matrix: NDArray[Any], x: Component, y: Component
) -> tuple[Component, Component, Component, Component, Component, Component]:
    (h11, h12, h13), (h21, h22, h23), (h31, h32, h33) = matrix.tolist()
    scale = 1.0 / (h31 * x + h32 * y + h33)
    u, v = (h11 * x + h12 * y + h13) * scale, (h21 * x + h22 * y + h23) * scale
    return (
        u,
        v,
        (h11 - u * h31) * scale,
        (h12 - u * h32) * scale,
        (h21 - v * h31) * scale,
        (h22 - v * h32) * scale,
    )
