"""The bent ray through parallel planes, from a camera to a point: Snell's law (Eq. 8, 9) solved.

A ray that crosses parallel planes stays in the plane of the normal through the camera's centre
and keeps one invariant, p = n sin(angle of incidence), in every layer. With t_i the thicknesses
(the camera's medium first, the target's last) and r the point's distance from the normal,

    sum_i t_i p / sqrt(n_i^2 - p^2) = r.

In p the sum has a pole at the lowest index n_m. Its tangent there, w = p / sqrt(n_m^2 - p^2), has
none: the sum becomes sum_i t_i n_m w / sqrt(n_i^2 + (n_i^2 - n_m^2) w^2), every term of which is
increasing and concave in w, so that Newton's method from the left climbs to the root without ever
passing it. Solving for q = w / r instead of w keeps the axis r = 0 regular, and with equal indices
makes the first guess exact: the pinhole.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Component = Any  # a float, or an array of floats
MAX_ITERATIONS = 6


class ParallelStack:
    """Parallel layers in front of one camera.

    Args:
        indices: of the media, the camera's first, the target's last.
        thicknesses: of all layers but the target's own, m: first the camera's distance from the
            first plane, so one fewer than there are indices.

    """

    def __init__(self, indices: tuple[float, ...], thicknesses: tuple[float, ...]) -> None:
        self.indices = indices
        self.thicknesses = thicknesses
        self.depth = sum(thicknesses)
        self.lowest = min(indices)

    def slope(self, rho: Component, height: Component) -> Component:
        """Return tan(angle of incidence at the camera) / r for points at radius sqrt(rho).

        Args:
            rho: squared distances from the normal through the camera's centre, m^2.
            height: of the points beyond the last plane, m; positive.

        """
        lowest = self.lowest
        thickness: dict[float, Component] = {}
        for t, n in zip((*self.thicknesses, height), self.indices, strict=True):
            thickness[n] = thickness.get(n, 0.0) + t
        thin = thickness.pop(lowest)
        rest = [(t * lowest, n * n, n * n - lowest * lowest) for n, t in thickness.items()]
        flat = thin + sum(t / a**0.5 for t, a, _ in rest)
        q = 1.0 / flat
        if rest:
            reach = sum(t / b**0.5 for t, _, b in rest)
            r = np.sqrt(rho)
            q = np.maximum(q, (r - reach) / (np.maximum(r, 1e-300) * thin))
            for _ in range(MAX_ITERATIONS):
                w2 = rho * q * q
                value, derivative = thin * q, thin
                for t, a, b in rest:
                    s = 1.0 / np.sqrt(a + b * w2)
                    value = value + t * q * s
                    derivative = derivative + t * a * s * s * s
                step = (1.0 - value) / derivative
                q = q + step
                if not (np.abs(step) > 1e-15 * q).any():
                    break
        first = self.indices[0] ** 2
        return lowest * q / np.sqrt(first + (first - lowest * lowest) * rho * q * q)
