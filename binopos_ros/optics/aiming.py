"""The ray to one point through planes at angles, a dome before them or not, on plain floats.

A ray leaves the camera along (a, b, 1), is bent at each surface and lands on the plane through the
target that is parallel to the last one. Its derivatives by a and b are carried along, and
Newton's method asks that it lands on the target. As there is only one ray (see `crossing.py`), the
one found is it; where Newton's method goes astray, near grazing, there is none found here, and
`crossing.crossings` and, behind a dome, `landing` find it more slowly from anywhere. The
derivatives by the target and by its medium's index follow from the last step (implicit function
theorem).
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from binopos_ros.optics.arithmetic import FLOATS
from binopos_ros.optics.departure import Departure, Vector
from binopos_ros.optics.surfaces import Row, Surfaces

MAX_STEPS = 10
#: Step of a and b that the next one would make about the square of.
SETTLED = 1e-9


class Aim(NamedTuple):
    """A ray's direction (a, b, 1) and its derivatives by the target, 1/m, and its index."""

    a: float
    b: float
    a_by_target: Vector
    b_by_target: Vector
    a_by_index: float
    b_by_index: float

    @property
    def departure(self) -> Departure:
        """The direction (a, b, 1) with its derivatives."""
        return Departure(
            (self.a, self.b, 1.0),
            (self.a_by_target, self.b_by_target, (0.0, 0.0, 0.0)),
            (self.a_by_index, self.b_by_index, 0.0),
        )


#: Where a ray leaves a surface, its derivatives by a and b, its direction beyond, its derivatives,
#: and its direction before that surface.
_Shot = tuple[Vector, tuple[Vector, Vector], Vector, tuple[Vector, Vector], Vector]


def aim(surfaces: Surfaces, target: Vector) -> Aim | None:
    """Return the ray from the camera's centre to a target beyond the last plane.

    Args:
        surfaces: at least one plane.
        target: m, camera frame.

    Returns:
        None where Newton's method finds no ray; there may be one, but for targets on the camera's
        side of the last plane.

    """
    tx, ty, tz = target
    nx, ny, nz, offset, _ = surfaces.planes[-1]
    # Not the other way round: nan lies nowhere.
    if not (tz > 0.0 and tx * nx + ty * ny + tz * nz > offset):
        return None
    a, b = tx / tz, ty / tz
    (px, py, pz), (qx, qy, qz) = surfaces.last_basis
    for _ in range(MAX_STEPS):
        ray = _shoot(surfaces, a, b)
        if ray is None:
            return None
        (x, y, z), (xa, xb), (ux, uy, uz), (ua, ub), before = ray
        cosine = ux * nx + uy * ny + uz * nz
        reach = ((tx - x) * nx + (ty - y) * ny + (tz - z) * nz) / cosine
        # What the landing misses the target by, and its derivatives, in the last plane's basis.
        ex, ey, ez = tx - x - reach * ux, ty - y - reach * uy, tz - z - reach * uz
        up, uq = px * ux + py * uy + pz * uz, qx * ux + qy * uy + qz * uz
        columns = []
        for (dx, dy, dz), (vx, vy, vz) in ((xa, ua), (xb, ub)):
            mx, my, mz = dx + reach * vx, dy + reach * vy, dz + reach * vz
            change = (mx * nx + my * ny + mz * nz) / cosine
            columns.append(
                (
                    px * mx + py * my + pz * mz - change * up,
                    qx * mx + qy * my + qz * mz - change * uq,
                )
            )
        (pa, qa), (pb, qb) = columns
        determinant = pa * qb - pb * qa
        if determinant == 0.0:
            return None
        ep, eq = px * ex + py * ey + pz * ez, qx * ex + qy * ey + qz * ez
        da = (qb * ep - pb * eq) / determinant
        db = (pa * eq - qa * ep) / determinant
        a, b = a + da, b + db
        if abs(da) + abs(db) <= SETTLED * (1.0 + abs(a) + abs(b)):
            break
    else:
        return None
    # Moving the target along the ray changes nothing.
    fp, fq = up / cosine, uq / cosine
    p_by = (px - fp * nx, py - fp * ny, pz - fp * nz)
    q_by = (qx - fq * nx, qy - fq * ny, qz - fq * nz)
    bent = surfaces.bent_by_last_index(before, FLOATS)
    slip = (bent[0] * nx + bent[1] * ny + bent[2] * nz) / cosine
    ip = reach * (px * bent[0] + py * bent[1] + pz * bent[2] - slip * up)
    iq = reach * (qx * bent[0] + qy * bent[1] + qz * bent[2] - slip * uq)
    aa, ab, ba, bb = qb / determinant, -pb / determinant, -qa / determinant, pa / determinant
    return Aim(
        a,
        b,
        (aa * p_by[0] + ab * q_by[0], aa * p_by[1] + ab * q_by[1], aa * p_by[2] + ab * q_by[2]),
        (ba * p_by[0] + bb * q_by[0], ba * p_by[1] + bb * q_by[1], ba * p_by[2] + bb * q_by[2]),
        -(aa * ip + ab * iq),
        -(ba * ip + bb * iq),
    )


def _shoot(surfaces: Surfaces, a: float, b: float) -> _Shot | None:
    """Follow a ray beyond the last surface; None where it is reflected or misses one."""
    scale = 1.0 / sqrt(a * a + b * b + 1.0)
    ux, uy, uz = u = a * scale, b * scale, scale
    by_a = (1.0 - ux * ux) * scale, -ux * uy * scale, -ux * uz * scale
    by_b = -uy * ux * scale, (1.0 - uy * uy) * scale, -uy * uz * scale
    zero = 0.0, 0.0, 0.0
    start = zero, (zero, zero), u, (by_a, by_b), u
    shot = _through_spheres(surfaces.spheres, start) if surfaces.spheres else start
    return None if shot is None else _through_planes(surfaces.planes, shot)


def _through_spheres(spheres: tuple[Row, ...], shot: _Shot) -> _Shot | None:
    (x, y, z), (by_a, by_b), (ux, uy, uz), (turned_a, turned_b), before = shot
    fx, fy, fz = by_a
    gx, gy, gz = by_b
    vx, vy, vz = turned_a
    wx, wy, wz = turned_b
    for cx, cy, cz, radius, ratio in spheres:
        before = ux, uy, uz
        rx, ry, rz = x - cx, y - cy, z - cz
        foot = rx * ux + ry * uy + rz * uz
        half = sqrt(radius * radius - (rx * rx + ry * ry + rz * rz) + foot * foot)
        reach, cosine = half - foot, half / radius
        square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
        if square <= 0.0:
            return None
        root = sqrt(square)
        along = root - ratio * cosine
        bend = ratio * (ratio * cosine / root - 1.0)  # d along / d cosine
        shift = along / radius  # the normal turns by the place over the radius
        x, y, z = x + reach * ux, y + reach * uy, z + reach * uz
        nx, ny, nz = (x - cx) / radius, (y - cy) / radius, (z - cz) / radius
        turn = fx * ux + fy * uy + fz * uz + rx * vx + ry * vy + rz * vz
        spread = (foot * turn - (rx * fx + ry * fy + rz * fz)) / half
        turn, spread = spread - turn, bend * spread / radius
        fx, fy, fz = (
            fx + turn * ux + reach * vx,
            fy + turn * uy + reach * vy,
            fz + turn * uz + reach * vz,
        )
        vx, vy, vz = (
            ratio * vx + spread * nx + shift * fx,
            ratio * vy + spread * ny + shift * fy,
            ratio * vz + spread * nz + shift * fz,
        )
        turn = gx * ux + gy * uy + gz * uz + rx * wx + ry * wy + rz * wz
        spread = (foot * turn - (rx * gx + ry * gy + rz * gz)) / half
        turn, spread = spread - turn, bend * spread / radius
        gx, gy, gz = (
            gx + turn * ux + reach * wx,
            gy + turn * uy + reach * wy,
            gz + turn * uz + reach * wz,
        )
        wx, wy, wz = (
            ratio * wx + spread * nx + shift * gx,
            ratio * wy + spread * ny + shift * gy,
            ratio * wz + spread * nz + shift * gz,
        )
        ux, uy, uz = ratio * ux + along * nx, ratio * uy + along * ny, ratio * uz + along * nz
    turned = (vx, vy, vz), (wx, wy, wz)
    return (x, y, z), ((fx, fy, fz), (gx, gy, gz)), (ux, uy, uz), turned, before


def _through_planes(planes: tuple[Row, ...], shot: _Shot) -> _Shot | None:
    (x, y, z), (by_a, by_b), (ux, uy, uz), (turned_a, turned_b), before = shot
    fx, fy, fz = by_a
    gx, gy, gz = by_b
    vx, vy, vz = turned_a
    wx, wy, wz = turned_b
    for nx, ny, nz, offset, ratio in planes:
        before = ux, uy, uz
        cosine = ux * nx + uy * ny + uz * nz
        if cosine <= 0.0:
            return None
        reach = (offset - (x * nx + y * ny + z * nz)) / cosine
        sine2 = 1.0 - cosine * cosine
        square = 1.0 - ratio * ratio * sine2
        if reach <= 0.0 or square <= 0.0:
            return None
        root = sqrt(square)
        along = root - ratio * cosine
        bend = ratio * (ratio * cosine / root - 1.0)  # d along / d cosine
        turn = vx * nx + vy * ny + vz * nz
        slip = -(fx * nx + fy * ny + fz * nz + reach * turn) / cosine
        fx, fy, fz = (
            fx + slip * ux + reach * vx,
            fy + slip * uy + reach * vy,
            fz + slip * uz + reach * vz,
        )
        turn *= bend
        vx, vy, vz = ratio * vx + turn * nx, ratio * vy + turn * ny, ratio * vz + turn * nz
        turn = wx * nx + wy * ny + wz * nz
        slip = -(gx * nx + gy * ny + gz * nz + reach * turn) / cosine
        gx, gy, gz = (
            gx + slip * ux + reach * wx,
            gy + slip * uy + reach * wy,
            gz + slip * uz + reach * wz,
        )
        turn *= bend
        wx, wy, wz = ratio * wx + turn * nx, ratio * wy + turn * ny, ratio * wz + turn * nz
        x, y, z = x + reach * ux, y + reach * uy, z + reach * uz
        ux, uy, uz = ratio * ux + along * nx, ratio * uy + along * ny, ratio * uz + along * nz
    turned = (vx, vy, vz), (wx, wy, wz)
    return (x, y, z), ((fx, fy, fz), (gx, gy, gz)), (ux, uy, uz), turned, before
