"""The maximum-likelihood point of a pair of pixels, along the bent rays.

The pixels are the point's images plus Gaussian noise of known covariance, so the likeliest point
minimises the whitened reprojection error. It starts from the middle of the two bent rays, traced
back (closed form), and takes Gauss-Newton steps with analytic derivatives until a step is a
millionth of a standard deviation: two or three. The covariance is the inverse Fisher information.

`fit_block` does thousands of points at once and gives up on the odd ones; `fit_point` does one on
plain floats, halves steps that do not help, and says why there is no point. Both run the same
kernels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.arithmetic import ARRAYS, FLOATS, Arithmetic, Component, NoRayError
from binopos_ros.optics.rig import StereoRig
from binopos_ros.optics.view import View
from binopos_ros.triangulation.meeting import Vector, dot, midpoint

BLOCK_STEPS = 4
CAREFUL_STEPS = 50
HALVINGS = 30
SETTLED = 1e-12  # squared step in standard deviations
DIVERGED = 'no point beyond the surface explains both pixels'

Pixel = tuple[Component, Component]
Whitening = tuple[Component, Component, Component]
Symmetric = tuple[Component, Component, Component, Component, Component, Component]


class Pair(NamedTuple):
    """What both cameras saw: pixels, and what whitens their noise (see `whitening`)."""

    left: Pixel
    right: Pixel
    left_whitening: Whitening
    right_whitening: Whitening


class Linear(NamedTuple):
    """The whitened problem about a point: four rows, left u, v then right u, v.

    residual = observed - predicted; rows are the prediction's derivatives by the point, by_index
    by the refractive index of the target's medium.
    """

    rows: tuple[Vector, Vector, Vector, Vector]
    residual: tuple[Component, Component, Component, Component]
    by_index: tuple[Component, Component, Component, Component]

    def cost(self) -> Component:
        """Return the squared whitened residual."""
        a, b, c, d = self.residual
        return a * a + b * b + c * c + d * d


class Fit(NamedTuple):
    """A fitted point, by component."""

    point: Vector  # m
    covariance: Symmetric  # xx xy xz yy yz zz, m^2
    residual: tuple[Component, Component, Component, Component]  # whitened
    by_index: Vector  # how the point moves with the index assumed, m
    decrement: Component  # squared length of the last step, in standard deviations
    linear: Linear  # the problem that the last step solved


def covariance_terms(covariances: NDArray[np.float64]) -> tuple[Component, ...]:
    """Return the four columns of (N, 2, 2) covariances."""
    return tuple(covariances.reshape(-1, 4).T)


def whitening(covariance: Sequence[Component], side: str, arithmetic: Arithmetic) -> Whitening:
    """Return the inverse Cholesky factor (l11, l21, l22) of a pixel's covariance, 1/px.

    The covariance is given row by row, px^2.

    One that is not symmetric and positive definite is not kept.
    """
    reason = not_positive_definite(side)
    xx, xy, yx, yy = covariance
    scale = xx + yy
    xx = arithmetic.keep(xx, (xx > 0.0) & (abs(xy - yx) <= 1e-6 * scale), reason)
    first = arithmetic.sqrt(xx)
    slope = xy / first
    rest = yy - slope * slope
    rest = arithmetic.keep(rest, (rest > 1e-12 * scale) & (scale < float('inf')), reason)
    second = arithmetic.sqrt(rest)
    return 1.0 / first, -slope / (first * second), 1.0 / second


def not_positive_definite(side: str) -> str:
    """Return the reason for refusing a covariance."""
    return f'the {side} covariance is not positive definite'


def colour(
    whitened: tuple[Component, Component], whitener: Whitening
) -> tuple[Component, Component]:
    """Undo a whitening: return the residual in pixels."""
    a, b = whitened
    l11, l21, l22 = whitener
    first = a / l11
    return first, (b - l21 * first) / l22


def fit_block(rig: StereoRig, pair: Pair) -> Fit:
    """Fit many points; where the last step has not settled, or is nan, try `fit_point`."""
    point = _start(rig, pair, ARRAYS)
    for _ in range(BLOCK_STEPS):
        linear = _linearise(rig, point, pair, ARRAYS)
        fit = _step(point, linear, ARRAYS)
        point = fit.point
        if not ARRAYS.any(fit.decrement > SETTLED):
            break
    return fit


def fit_point(rig: StereoRig, pair: Pair, near: Vector | None = None) -> Fit:
    """Fit one point, given in floats; from `near` on, where that is known.

    Raises:
        NoRayError: there is none; says why.

    """
    point = near or _start(rig, pair, FLOATS)
    linear = _linearise(rig, point, pair, FLOATS)
    for _ in range(CAREFUL_STEPS):
        fit = _step(point, linear, FLOATS)
        if fit.decrement <= SETTLED:
            return fit
        point, linear = _descend(rig, point, linear, fit.point, pair)
    raise NoRayError(DIVERGED)


def _start(rig: StereoRig, pair: Pair, arithmetic: Arithmetic) -> Vector:
    left = rig.left_view.ray(*pair.left, arithmetic)
    right = rig.right_view.ray(*pair.right, arithmetic)
    return midpoint(left, right, arithmetic)[0]


def _descend(
    rig: StereoRig, point: Vector, linear: Linear, aim: Vector, pair: Pair
) -> tuple[Vector, Linear]:
    """Go towards `aim`, halving the step while it leaves the medium or explains less."""
    cost = linear.cost()
    reason = DIVERGED
    for _ in range(HALVINGS):
        try:
            further = _linearise(rig, aim, pair, FLOATS)
        except NoRayError as no_ray:
            reason = str(no_ray)
        else:
            # At the optimum rounding decides between two equal costs.
            if further.cost() <= cost * (1.0 + 1e-9) + 1e-18:
                return aim, further
        aim = (
            0.5 * (point[0] + aim[0]),
            0.5 * (point[1] + aim[1]),
            0.5 * (point[2] + aim[2]),
        )
    raise NoRayError(reason)


def _linearise(rig: StereoRig, point: Vector, pair: Pair, arithmetic: Arithmetic) -> Linear:
    left = _whitened(rig.left_view, point, pair.left, pair.left_whitening, arithmetic)
    right = _whitened(rig.right_view, point, pair.right, pair.right_whitening, arithmetic)
    return Linear(left[0] + right[0], left[1] + right[1], left[2] + right[2])


def _whitened(
    view: View, point: Vector, pixel: Pixel, whitener: Whitening, arithmetic: Arithmetic
) -> tuple[tuple[Vector, Vector], Pixel, Pixel]:
    """Return one camera's two rows, residuals and derivatives by the index, whitened."""
    sight = view.sight(point, arithmetic)
    l11, l21, l22 = whitener
    (ux, uy, uz), (vx, vy, vz) = sight.u_by_point, sight.v_by_point
    first, second = pixel[0] - sight.u, pixel[1] - sight.v
    return (
        (
            (l11 * ux, l11 * uy, l11 * uz),
            (l21 * ux + l22 * vx, l21 * uy + l22 * vy, l21 * uz + l22 * vz),
        ),
        (l11 * first, l21 * first + l22 * second),
        (l11 * sight.u_by_index, l21 * sight.u_by_index + l22 * sight.v_by_index),
    )


def _step(point: Vector, linear: Linear, arithmetic: Arithmetic) -> Fit:
    """Take one Gauss-Newton step: solve the normal equations by Cholesky's factorisation."""
    (p, q, r, s), (e, f, g, h) = linear.rows, linear.residual
    xx = p[0] * p[0] + q[0] * q[0] + r[0] * r[0] + s[0] * s[0]
    xy = p[0] * p[1] + q[0] * q[1] + r[0] * r[1] + s[0] * s[1]
    xz = p[0] * p[2] + q[0] * q[2] + r[0] * r[2] + s[0] * s[2]
    yy = p[1] * p[1] + q[1] * q[1] + r[1] * r[1] + s[1] * s[1]
    yz = p[1] * p[2] + q[1] * q[2] + r[1] * r[2] + s[1] * s[2]
    zz = p[2] * p[2] + q[2] * q[2] + r[2] * r[2] + s[2] * s[2]
    covariance = _inverse((xx, xy, xz, yy, yz, zz), arithmetic)
    gradient = _against(linear.rows, linear.residual)
    step = _times(covariance, gradient)
    by_index = _times(covariance, _against(linear.rows, linear.by_index))
    return Fit(
        (point[0] + step[0], point[1] + step[1], point[2] + step[2]),
        covariance,
        (e - dot(p, step), f - dot(q, step), g - dot(r, step), h - dot(s, step)),
        (-by_index[0], -by_index[1], -by_index[2]),
        dot(gradient, step),
        linear,
    )


def _inverse(matrix: Symmetric, arithmetic: Arithmetic) -> Symmetric:
    xx, xy, xz, yy, yz, zz = matrix
    a = 1.0 / arithmetic.sqrt(xx)
    b, d = xy * a, xz * a
    c = yy - b * b
    c = 1.0 / arithmetic.sqrt(arithmetic.keep(c, c > 0.0, DIVERGED))
    e = (yz - b * d) * c
    f = zz - d * d - e * e
    f = 1.0 / arithmetic.sqrt(arithmetic.keep(f, f > 0.0, DIVERGED))
    # The factor's inverse is lower triangular, with a, c, f on its diagonal.
    g = -b * a * c
    i = -e * c * f
    h = -(d * a + e * g) * f
    return a * a + g * g + h * h, g * c + h * i, h * f, c * c + i * i, i * f, f * f


def _times(matrix: Symmetric, vector: Vector) -> Vector:
    xx, xy, xz, yy, yz, zz = matrix
    x, y, z = vector
    return xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z


def _against(
    rows: tuple[Vector, Vector, Vector, Vector],
    values: tuple[Component, Component, Component, Component],
) -> Vector:
    """Return rows^T values."""
    (p, q, r, s), (e, f, g, h) = rows, values
    return (
        p[0] * e + q[0] * f + r[0] * g + s[0] * h,
        p[1] * e + q[1] * f + r[1] * g + s[1] * h,
        p[2] * e + q[2] * f + r[2] * g + s[2] * h,
    )
