"""The bent ray through a dome: concentric spheres around a camera that stands beside their centre.

Everything lies in the plane through camera, centre and point. In a medium of index n the ray is a
line whose distance from the centre is p / n, with one invariant p for all media (Bouguer's form of
Snell's law), and at a sphere of radius R it turns by asin(p / n R) - asin(p / n' R). Let D be the
point's distance from the camera, e the unit vector towards it, c the centre with c_e along e and
c_w = c - c_e e across it, and h = |c_w|. The ray leaves the camera along e + tau c_w, so that

    p = n_0 h beta,    beta = (1 - tau c_e) k,    k = 1 / sqrt(1 + tau^2 h^2),

and with t the angle from e to the ray in the last medium it meets the point where

    cos t + (D - c_e) sin t / h - p / (n h) = 0.

Every angle here has a sine that is h times something finite: the angles are added as products of
(cosine, sine / h), without an arc and without dividing by h. So the axis h = 0 is regular; with
equal indices, or the camera in the centre, tau = 0 or c = 0 give the pinhole. The equation rises
from the ray that leaves straight away from the centre to the one straight towards it, so the one
unknown is found by Newton's method between those two.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from binopos_ros.optics.arithmetic import Arithmetic, Component
from binopos_ros.optics.departure import Departure, Vector
from binopos_ros.optics.surfaces import CAMERA_SIDE, TOTAL_REFLECTION, Row

MAX_STEPS = 40
SETTLED = 1e-9  # rad; the error falls with the square of the step, so this one was the last
TINY = 1e-300
GRAZING = 1e-9  # squared cosine at which a ray is taken for totally reflected


class _Geometry(NamedTuple):
    """A point as the dome sees it: distance D, m; c_e, m; h^2, m^2."""

    distance: Component
    along: Component
    square: Component


class _Ray(NamedTuple):
    """A trial direction, and how the ray that leaves along it meets the point.

    Attributes:
        k: cosine of the angle from the point's direction to the ray.
        invariant: p / h.
        cosine: of the angle t in the last medium.
        sine: of it, over h.
        miss: left side of the equation above.
        lever: from the foot of the centre on the last line to the point, m.
        gain: d(angle t) by d(p / n_0), without that of the start, 1/m.
        steep: d(miss h) by the angle at the camera, m.
        last: n R times the cosine beyond the outer sphere, m.

    """

    k: Component
    invariant: Component
    cosine: Component
    sine: Component
    miss: Component
    lever: Component
    gain: Component
    steep: Component
    last: Component


class DomePath:
    """The path through a dome (see `departure.Path`).

    Args:
        spheres: the two, as `Surfaces` has them.
        indices: of the media, of which the first three count.

    """

    def __init__(self, spheres: tuple[Row, ...], indices: tuple[float, ...]) -> None:
        (cx, cy, cz, inner, _), (_, _, _, outer, _) = spheres
        first, wall, last = indices[:3]
        self._centre: Vector = (cx, cy, cz)
        self._offset2 = cx * cx + cy * cy + cz * cz
        self._offset = math.sqrt(self._offset2)
        self._outer2 = outer * outer
        self._first, self._last = first, last
        # Squares of n R on both sides of the inner and of the outer sphere.
        self._squares = tuple(
            (n * r) ** 2 for n, r in ((first, inner), (wall, inner), (wall, outer), (last, outer))
        )
        self._scale = 1.0 / (first * wall * inner * inner * wall * last * outer * outer)

    def direction(self, point: Vector, arithmetic: Arithmetic) -> Vector:
        """Return a vector along the ray: D (e + tau c_w)."""
        at, tau, _ = self._solve(point, arithmetic)
        (x, y, z), (cx, cy, cz) = point, self._centre
        straight, aside = 1.0 - tau * at.along, tau * at.distance
        return straight * x + aside * cx, straight * y + aside * cy, straight * z + aside * cz

    def differentiate(self, point: Vector, arithmetic: Arithmetic) -> Departure:
        """Return the unit direction k (e + tau c_w) and its derivatives.

        A point that moves in the plane turns the ray in the plane (implicit function theorem); one
        that moves out of it turns the plane about the line through camera and centre.
        """
        (distance, along, square), tau, ray = self._solve(point, arithmetic)
        k, p, last = ray.k, ray.invariant, self._last
        ex, ey, ez = (coordinate / distance for coordinate in point)
        cx, cy, cz = self._centre
        wx, wy, wz = cx - along * ex, cy - along * ey, cz - along * ez
        inverse = 1.0 / ray.steep
        pull = ray.lever * ray.gain - self._first / last
        by_along = (pull * tau * k + ray.sine) * inverse  # d(angle) / d(c_e) / h
        by_across = -(pull * k + ray.cosine) * inverse  # d(angle) / d(h)
        by_distance = -ray.sine * inverse  # d(angle) / d(D) / h
        by_index = (ray.lever / ray.last - 1.0 / last) * (p / last) * inverse  # over h
        turn = (1.0 + square * by_along - along * by_across) / distance
        tilt = p / (self._first * distance)
        # The matrix: a e e^T + b e w^T + c w e^T + d w w^T + tilt 1, with w = c_w.
        a = -k * square * tau * by_distance - tilt
        b = -k * tau * turn
        c = k * by_distance
        d = (k * turn - tilt) / arithmetic.maximum(square, TINY)
        fx, fy, fz = a * ex + b * wx, a * ey + b * wy, a * ez + b * wz
        gx, gy, gz = c * ex + d * wx, c * ey + d * wy, c * ez + d * wz
        back, aside = -k * square * tau * by_index, k * by_index
        return Departure(
            (k * (ex + tau * wx), k * (ey + tau * wy), k * (ez + tau * wz)),
            (
                (ex * fx + wx * gx + tilt, ex * fy + wx * gy, ex * fz + wx * gz),
                (ey * fx + wy * gx, ey * fy + wy * gy + tilt, ey * fz + wy * gz),
                (ez * fx + wz * gx, ez * fy + wz * gy, ez * fz + wz * gz + tilt),
            ),
            (back * ex + aside * wx, back * ey + aside * wy, back * ez + aside * wz),
        )

    def _solve(self, point: Vector, arithmetic: Arithmetic) -> tuple[_Geometry, Component, _Ray]:
        sqrt, maximum, where = arithmetic.sqrt, arithmetic.maximum, arithmetic.where
        (x, y, z), (cx, cy, cz) = point, self._centre
        square = x * x + y * y + z * z
        distance = sqrt(square)
        inner = x * cx + y * cy + z * cz
        outside = square - 2.0 * inner + self._offset2
        distance = arithmetic.keep(distance, outside > self._outer2, CAMERA_SIDE)
        along = inner / distance
        at = _Geometry(distance, along, maximum(self._offset2 - along * along, 0.0))
        # Between the ray away from the centre and the one towards it, as far as both lie ahead.
        end = 1.0 / where(abs(along) > TINY, along, TINY)
        low, high = where(along < 0.0, end, -math.inf), where(along > 0.0, end, math.inf)
        tau = 0.0 * distance
        for _ in range(MAX_STEPS):
            ray = self._ray(tau, at, arithmetic)
            further = tau - ray.miss / (ray.k * ray.k * ray.steep)
            short = ray.miss < 0.0
            low, high = where(short, tau, low), where(short, high, tau)
            inside = (further >= low) & (further <= high)
            further = where(inside, further, 0.5 * (tau + where(short, high, low)))
            change = abs(further - tau) * ray.k * ray.k * self._offset
            tau = further
            # The last step is too short to show in the derivatives, so the ray stays.
            if not arithmetic.any(change > SETTLED):
                break
        return at, arithmetic.keep(tau, change <= SETTLED, TOTAL_REFLECTION), ray

    def _ray(self, tau: Component, at: _Geometry, arithmetic: Arithmetic) -> _Ray:
        sqrt, maximum = arithmetic.sqrt, arithmetic.maximum
        distance, along, square = at
        k = 1.0 / sqrt(1.0 + tau * tau * square)
        p = self._first * (1.0 - tau * along) * k
        p2 = p * p * square
        q0, q1, q2, q3 = self._squares
        w0, w1 = sqrt(maximum(q0 - p2, GRAZING * q0)), sqrt(maximum(q1 - p2, GRAZING * q1))
        w2, w3 = sqrt(maximum(q2 - p2, GRAZING * q2)), sqrt(maximum(q3 - p2, GRAZING * q3))
        # Turn by the inner sphere, then by the outer, then from the direction at the camera.
        c1, s1, c2, s2 = w0 * w1 + p2, p * (w0 - w1), w2 * w3 + p2, p * (w2 - w3)
        c, s = c1 * c2 - square * s1 * s2, c1 * s2 + s1 * c2
        scale, start = k * self._scale, tau * square
        cosine, sine = scale * (c - start * s), scale * (s + tau * c)
        beyond = distance - along
        lever = beyond * cosine - square * sine
        gain = self._first * (1.0 / w1 - 1.0 / w0 + 1.0 / w3 - 1.0 / w2)
        foot = k * (along + start)
        steep = lever * (1.0 - foot * gain) + foot * (self._first / self._last)
        miss = cosine + beyond * sine - p / self._last
        return _Ray(k, p, cosine, sine, miss, lever, gain, steep, w3)
