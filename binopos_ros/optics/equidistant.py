"""The equidistant lens of Kannala and Brandt with four terms, forwards and backwards.

A ray at the angle t off the axis comes to lie at

    d(t) = t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8)

focal lengths from the principal point: J. Kannala and S. Brandt, "A generic camera model and
calibration method for conventional, wide-angle, and fish-eye lenses", IEEE PAMI 28 (2006), Eq. 6
with k1 = 1. ROS calls it `equidistant`, OpenCV `fisheye`.

Coordinates are those of the image plane (see `lens.py`): the tangent of t and its inverse keep all
digits up to 90 degrees, and what lies farther off is refused.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import ARRAYS, Arithmetic, Component
from binopos_ros.optics.distortion import OUT_OF_FIELD
from binopos_ros.optics.errors import OpticsError

TERMS = 4
RIGHT_ANGLE = math.pi / 2.0
BEYOND = '90 degrees or more off the axis'
MAX_STEPS = 60
SETTLED = 1e-9  # rad; the error falls with the square of the step, so this one was the last
TINY = 1e-150  # so small that no ray notices, so large that its square stays above 0


class EquidistantLens:
    """An equidistant lens on the image plane (see `lens.Lens`).

    Args:
        coefficients: k1 to k4; none at all is four zeros.

    Raises:
        OpticsError: another number of terms, or one that is not finite.

    """

    model = 'equidistant'
    behind = BEYOND

    def __init__(self, coefficients: ArrayLike) -> None:
        terms = np.array(coefficients, dtype=float).ravel()
        if terms.size not in (0, TERMS):
            msg = f'an equidistant lens has {TERMS} terms (k1 to k4), not {terms.size}'
            raise OpticsError(msg)
        if not np.isfinite(terms).all():
            msg = f'distortion holds a number that is not finite: {terms.tolist()}'
            raise OpticsError(msg)
        terms = terms if terms.size else np.zeros(TERMS)
        terms.flags.writeable = False
        self.coefficients: NDArray[np.float64] = terms
        self._k = tuple(terms.tolist())
        fold = _fold(self._k)
        self._limit, self._beyond = (
            (fold, OUT_OF_FIELD) if fold < RIGHT_ANGLE else (RIGHT_ANGLE, BEYOND)
        )
        self._reach = self._image(self._limit)[0]
        self.fold_radius_squared = math.tan(fold) ** 2 if fold < RIGHT_ANGLE else math.inf

    def distort(
        self, x: Component, y: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Move ideal image-plane coordinates to where the lens puts them."""
        r = arithmetic.maximum(arithmetic.sqrt(x * x + y * y), TINY)
        scale = self._image(arithmetic.arctan(r))[0] / r
        return x * scale, y * scale

    def distort_with_jacobian(
        self, x: Component, y: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component, Component, Component, Component, Component]:
        """Return xd, yd, and d(xd)/dx, d(xd)/dy, d(yd)/dx, d(yd)/dy."""
        r = arithmetic.maximum(arithmetic.sqrt(x * x + y * y), TINY)
        r2 = r * r
        image, slope = self._image(arithmetic.arctan(r))
        scale = image / r
        # d(scale)/dr / r; what it loses to cancellation near the axis, x^2 below takes back.
        steep = (slope / (1.0 + r2) - scale) / r2
        cross = x * y * steep
        return x * scale, y * scale, scale + x * x * steep, cross, cross, scale + y * y * steep

    def by_terms(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Differentiate the distorted coordinates by k1 to k4: (N, 2, 4) for (N,) x and y."""
        r = np.maximum(np.hypot(x, y), TINY)
        angle = np.arctan(r)
        powers = angle[:, None] ** (3 + 2 * np.arange(TERMS)) / r[:, None]
        jacobian: NDArray[np.float64] = np.stack([x, y], axis=1)[:, :, None] * powers[:, None]
        return jacobian

    def within_fold(self, x: Component, y: Component) -> Component:
        """Tell where the lens is one-to-one: inside the angle where its image turns back."""
        return x * x + y * y < self.fold_radius_squared

    def undistort(
        self, xd: Component, yd: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Invert `distort` to rounding; nan where nothing within the field images there.

        Newton's method on the angle, and a bisection wherever a step would leave what the signs
        so far allow.
        """
        where = arithmetic.where
        d = arithmetic.sqrt(xd * xd + yd * yd)
        d = arithmetic.keep(d, d < self._reach, self._beyond)
        wanted = where(d < self._reach, d, 0.0)  # what is lost would never settle
        low, high = 0.0 * wanted, 0.0 * wanted + self._limit
        angle = arithmetic.minimum(wanted, 0.9 * self._limit)
        for _ in range(MAX_STEPS):
            image, slope = self._image(angle)
            missing = wanted - image
            low, high = where(missing > 0.0, angle, low), where(missing > 0.0, high, angle)
            further = angle + missing / slope
            inside = (further >= low) & (further <= high)
            further = where(inside, further, 0.5 * (low + high))
            change = where(inside, abs(further - angle), math.inf)
            angle = further
            if not arithmetic.any(change > SETTLED):
                break
        scale = arithmetic.tan(angle) / arithmetic.maximum(d, TINY)
        return xd * scale, yd * scale

    def _image(self, angle: Component) -> tuple[Component, Component]:
        """Return d(t) and its derivative."""
        k1, k2, k3, k4 = self._k
        t2 = angle * angle
        gain = 1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))
        slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
        return angle * gain, slope


def _fold(terms: tuple[float, ...]) -> float:
    """Return the smallest angle at which d(t) turns back; inf if none."""
    slopes = [1.0, *((3 + 2 * i) * k for i, k in enumerate(terms))]
    # The polynomial begins with 1, so that of 1 / t^2 is monic: stable for terms however small.
    roots = np.roots(slopes)
    real = roots[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0.0)].real
    return 1.0 / math.sqrt(float(real.max())) if real.size else math.inf
