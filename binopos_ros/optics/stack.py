"""The bent ray through parallel planes, from a camera to a point: Snell's law (Eq. 8, 9) solved.

A ray that crosses parallel planes stays in the plane of the normal through the camera's centre
and keeps one invariant, p = n sin(angle of incidence), in every layer. With t_i the thicknesses
(the camera's medium first, the target's last) and r the point's distance from the normal,

    sum_i t_i p / sqrt(n_i^2 - p^2) = r.

In p the sum has a pole at the lowest index n_m. The tangent of the angle in that medium,
w = p / sqrt(n_m^2 - p^2), has none: the sum is

    sum_i t_i n_m w / sqrt(n_i^2 + (n_i^2 - n_m^2) w^2),

every term of it increasing and concave in w, with two asymptotes: a line through the origin for
small w, and for large w a line of the slope of the thinnest medium alone. Both lie above the sum,
so the larger of their roots is a start on the left, and Newton's method climbs from there. Each
step is Newton's on F / sqrt(F') (Halley), whose order is three; as w F'' / F' never exceeds 3,
six steps are enough at any incidence. Solving for q = w / r in place of w keeps the axis r = 0
regular, and with equal indices the start is already exact: the pinhole.
"""

from __future__ import annotations

from typing import NamedTuple

from binopos_ros.optics.arithmetic import ARRAYS, Arithmetic, Component

MAX_ITERATIONS = 6
SETTLED = 1e-6  # relative step after which the cubic remainder is below rounding
TINY = 1e-150  # so small that no ray notices, so large that dividing by it stays finite


class Bend(NamedTuple):
    """The slope tan(angle of incidence at the camera) / r of a ray, and how it changes."""

    slope: Component  # 1/m
    by_rho: Component  # with the squared radius r^2, 1/m^3
    by_height: Component  # with the point's height beyond the last plane, 1/m^2
    by_target_index: Component  # 1/m


class ParallelStack:
    """Parallel layers in front of one camera.

    Args:
        indices: of the media, the camera's first, the target's last.
        thicknesses: of all layers but the target's own, m: first the camera's distance from the
            first plane, so one fewer than there are indices.

    """

    def __init__(self, indices: tuple[float, ...], thicknesses: tuple[float, ...]) -> None:
        self.depth = sum(thicknesses)
        self._first, self._last = indices[0], indices[-1]
        self._lowest = min(indices)
        total = dict.fromkeys(indices, 0.0)  # layers of one index act as one
        for thickness, index in zip(thicknesses, indices[:-1], strict=True):
            total[index] += thickness
        self._thin = total.pop(self._lowest)
        self._others = tuple(
            (index, thickness, index * index, self._excess(index))
            for index, thickness in total.items()
        )

    def slope(
        self, rho: Component, height: Component, arithmetic: Arithmetic = ARRAYS
    ) -> Component:
        """Return tan(angle of incidence at the camera) / r.

        Args:
            rho: the points' squared distances from the normal through the camera's centre, m^2.
            height: of the points beyond the last plane, m; positive.
            arithmetic: of arrays or of floats.

        """
        q = self._solve(rho, height, arithmetic)
        excess = self._excess(self._first)
        if excess == 0.0:
            return q
        first = self._first * self._first + excess * rho * q * q
        return self._lowest * q / arithmetic.sqrt(first)

    def bend(self, rho: Component, height: Component, arithmetic: Arithmetic) -> Bend:
        """Return the slope and its derivatives, by the implicit function theorem.

        With P = p / r and c_i = sqrt(n_i^2 - p^2), the ray solves sum_i t_i P / c_i = 1 and the
        slope is P / c_0.
        """
        sqrt = arithmetic.sqrt
        q = self._solve(rho, height, arithmetic)
        w2 = rho * q * q
        cosine2 = 1.0 / (1.0 + w2)  # squared, in the medium of the lowest index
        cosine = sqrt(cosine2)
        lowest2 = self._lowest * self._lowest
        invariant = self._lowest * q * cosine
        first2 = self._first * self._first
        first = last = self._lowest * cosine
        thin = self._thin
        last_cube = height / (first * first * first)
        if self._last == self._lowest:
            thin = thin + height
        cube = thin / (first * first * first)
        moment = lowest2 * cube  # sum_i t_i n_i^2 / c_i^3
        contrast = -self._excess(self._first) * cube  # sum_i t_i (n_i^2 - n_0^2) / c_i^3
        for index, known, square, excess in self._others:
            thickness = known + height if index == self._last else known
            c = sqrt((square + excess * w2) * cosine2)
            cube = thickness / (c * c * c)
            moment = moment + square * cube
            contrast = contrast + (square - first2) * cube
            if index == self._first:
                first = c
            if index == self._last:
                last = c
                last_cube = height / (c * c * c)
        gain = first2 / (first * first * first)  # d slope / d P
        half = 0.5 * invariant * invariant * invariant / (first * first * first)
        return Bend(
            invariant / first,
            half * contrast / moment,
            -gain * invariant / (last * moment),
            gain * invariant * self._last * last_cube / moment,
        )

    def _excess(self, index: float) -> float:
        """Return index^2 - lowest^2, with no digits lost where the two are almost alike."""
        return (index - self._lowest) * (index + self._lowest)

    def _solve(self, rho: Component, height: Component, arithmetic: Arithmetic) -> Component:
        sqrt, maximum, any_ = arithmetic.sqrt, arithmetic.maximum, arithmetic.any
        thin, layers = self._thin, []
        if self._last == self._lowest:
            thin = thin + height
        for index, known, square, excess in self._others:
            thickness = known + height if index == self._last else known
            layers.append((index, thickness * self._lowest, square, excess))
        flat, reach = thin, 0.0
        for index, thickness, _, excess in layers:
            flat = flat + thickness / index
            reach = reach + thickness / sqrt(excess)
        q = 1.0 / flat
        if not layers:
            return q
        r = sqrt(rho)
        q = start = maximum(q, (r - reach) / (maximum(r, TINY) * thin))
        for _ in range(MAX_ITERATIONS):
            rho_q = rho * q
            w2 = rho_q * q
            missing, slope, curvature = 1.0 - thin * q, thin, 0.0
            for _, thickness, square, excess in layers:
                s = 1.0 / sqrt(square + excess * w2)
                missing = missing - thickness * q * s
                steep = square * thickness * s * s * s
                slope = slope + steep
                curvature = curvature + (excess * s * s) * steep
            newton = missing / slope
            # Halley's correction; curvature here is -F'' / (3 rho q).
            step = newton / maximum(1.0 - 1.5 * rho_q * newton * curvature / slope, 0.3)
            q = maximum(q + step, start)
            if not any_(abs(step) > SETTLED * q):
                break
        return q
