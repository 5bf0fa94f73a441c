"""The ray to a point through a dome and then through planes, as a housing before a tank's wall.

A ray leaves the camera along a unit vector, is bent at each surface and lands on the plane through
the target that is parallel to the last one. Two derivatives are carried along, by small turns of
the ray about two axes across it, and Newton's method asks that it lands on the target. A step that
does not bring it nearer is halved. The start is the ray through the dome alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from binopos_ros.optics.aiming import aim
from binopos_ros.optics.arithmetic import FLOATS, Arithmetic, Component
from binopos_ros.optics.departure import Departure, Vector
from binopos_ros.optics.dome_path import DomePath
from binopos_ros.optics.surfaces import CAMERA_SIDE, MISSES_SURFACE, Surfaces

MAX_STEPS = 60
SETTLED = 1e-9  # rad; the error falls with the square of the step, so this one was the last
SHORTEST = 1e-3  # part of Newton's step below which a ray is given up


def _root(value: float) -> float:
    return math.sqrt(value) if value >= 0.0 else math.nan


def _kept(value: float, condition: bool, _: str) -> float:
    return value if condition else math.nan


#: On floats too, a trial ray that does not exist is nan: another one is tried.
_TRIAL = FLOATS._replace(sqrt=_root, keep=_kept)


class _Landing(NamedTuple):
    """By what a ray misses the target, in the last plane's basis, and its derivatives.

    Attributes:
        miss: two components, m.
        by: the derivatives of both by the first turn and by the second, m.
        direction: of the ray in the target's medium.
        before: of the ray before the last plane.
        reach: from the last plane to the landing, m.

    """

    miss: tuple[Component, Component]
    by: tuple[tuple[Component, Component], tuple[Component, Component]]
    direction: Vector
    before: Vector
    reach: Component


class BehindDomePath:
    """The path through a dome and planes behind it (see `departure.Path`)."""

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        self._dome = DomePath(surfaces.spheres, surfaces.indices)
        self._basis = surfaces.last_basis

    def direction(self, point: Vector, arithmetic: Arithmetic) -> Vector:
        """Return the direction at the camera: with z = 1, or of unit length."""
        aimed = aim(self._surfaces, point) if arithmetic is FLOATS else None
        return self._aim(point, arithmetic)[0] if aimed is None else (aimed.a, aimed.b, 1.0)

    def differentiate(self, point: Vector, arithmetic: Arithmetic) -> Departure:
        """Return it with its derivatives, by the implicit function theorem."""
        aimed = aim(self._surfaces, point) if arithmetic is FLOATS else None
        if aimed is not None:
            return aimed.departure
        u, landing, determinant = self._aim(point, arithmetic)
        (pa, qa), (pb, qb) = landing.by
        first, second = _across(u)
        nx, ny, nz, _, _ = self._surfaces.planes[-1]
        (px, py, pz), (qx, qy, qz) = self._basis
        ux, uy, uz = landing.direction
        cosine = ux * nx + uy * ny + uz * nz
        # A target that moves along the ray changes nothing.
        up, uq = px * ux + py * uy + pz * uz, qx * ux + qy * uy + qz * uz
        fp, fq = up / cosine, uq / cosine
        p_by = (px - fp * nx, py - fp * ny, pz - fp * nz)
        q_by = (qx - fq * nx, qy - fq * ny, qz - fq * nz)
        bx, by, bz = self._surfaces.bent_by_last_index(landing.before, arithmetic)
        slip = (bx * nx + by * ny + bz * nz) / cosine
        ip = -landing.reach * (px * bx + py * by + pz * bz - slip * up)
        iq = -landing.reach * (qx * bx + qy * by + qz * bz - slip * uq)
        columns = (*zip(p_by, q_by, strict=True), (ip, iq))
        turned = []
        for p, q in columns:
            a, b = (qb * p - pb * q) / determinant, (pa * q - qa * p) / determinant
            turned.append([a * f + b * s for f, s in zip(first, second, strict=True)])
        x, y, z, index = turned
        rows = tuple((x[i], y[i], z[i]) for i in range(3))
        return Departure(u, rows, tuple(index))  # type: ignore[arg-type]

    def _aim(self, point: Vector, arithmetic: Arithmetic) -> tuple[Vector, _Landing, Component]:
        """Return the unit direction, how it lands, and the determinant of its derivatives."""
        x, y, z = point
        nx, ny, nz, offset, _ = self._surfaces.planes[-1]
        beyond = x * nx + y * ny + z * nz > offset
        x = arithmetic.keep(x, beyond, CAMERA_SIDE)
        trial = _TRIAL if arithmetic is FLOATS else arithmetic
        where, any_ = trial.where, trial.any
        u = _unit(self._dome.direction((x, y, z), arithmetic), trial)
        landing = self._land(u, (x, y, z), trial)
        for _ in range(MAX_STEPS):
            # Totally reflected, or past a plane: there is light nearer to the last normal.
            lands = trial.where(_square(landing.miss) >= 0.0, True, False)
            if not any_(trial.where(beyond, 1.0 - lands, 0.0)):
                break
            turned = _unit((u[0] + nx, u[1] + ny, u[2] + nz), trial)
            u = tuple(where(lands, old, new) for new, old in zip(turned, u, strict=True))
            landing = self._land(u, (x, y, z), trial)
        share = change = 1.0 + 0.0 * x
        for _ in range(MAX_STEPS):
            (pa, qa), (pb, qb) = landing.by
            determinant = pa * qb - pb * qa
            p, q = landing.miss
            a = share * (pb * q - qb * p) / determinant
            b = share * (qa * p - pa * q) / determinant
            first, second = _across(u)
            tried = _unit(
                tuple(v + a * f + b * s for v, f, s in zip(u, first, second, strict=True)), trial
            )
            further = self._land(tried, (x, y, z), trial)
            size = trial.sqrt(a * a + b * b)
            # At the last digit the miss no longer tells better from worse.
            nearer = (_square(further.miss) < _square(landing.miss)) | (size < SETTLED)
            u = tuple(where(nearer, new, old) for new, old in zip(tried, u, strict=True))
            landing = _chosen(nearer, further, landing, trial)
            change = where(nearer, size, math.inf)
            share = where(nearer, trial.minimum(1.0, 4.0 * share), 0.5 * share)
            # A share of a step may be short because it was cut short, and nan never settles.
            change = where(share < 1.0, math.inf, change)
            if not any_((change > SETTLED) & (share > SHORTEST)):
                break
        (pa, qa), (pb, qb) = landing.by
        ux = arithmetic.keep(u[0], change <= SETTLED, MISSES_SURFACE)
        return (ux, u[1], u[2]), landing, pa * qb - pb * qa

    def _land(self, u: Vector, target: Vector, trial: Arithmetic) -> _Landing:
        """Follow a ray, and its derivatives by turns about its two axes, to the last plane."""
        sqrt, keep = trial.sqrt, trial.keep
        x: Vector = (0.0 * u[0], 0.0 * u[0], 0.0 * u[0])
        dx: tuple[Vector, ...] = (x, x)
        du: tuple[Vector, ...] = _across(u)
        before = u
        for cx, cy, cz, radius, ratio in self._surfaces.spheres:
            r = (x[0] - cx, x[1] - cy, x[2] - cz)
            along = _dot(r, u)
            half = sqrt(radius * radius - _dot(r, r) + along * along)
            reach, cosine = half - along, half / radius
            dalong = tuple(_dot(d, u) + _dot(r, v) for d, v in zip(dx, du, strict=True))
            dhalf = tuple(
                (along * da - _dot(r, d)) / half for d, da in zip(dx, dalong, strict=True)
            )
            dx = tuple(
                _sum(d, dh - da, u, reach, v)
                for d, v, dh, da in zip(dx, du, dhalf, dalong, strict=True)
            )
            x = _sum(x, reach, u, 0.0, u)
            normal = ((x[0] - cx) / radius, (x[1] - cy) / radius, (x[2] - cz) / radius)
            turns = tuple((d[0] / radius, d[1] / radius, d[2] / radius) for d in dx)
            dcosine = tuple(dh / radius for dh in dhalf)
            u, du = _refracted(u, du, normal, turns, cosine, dcosine, ratio, trial)
        for nx, ny, nz, offset, ratio in self._surfaces.planes:
            normal = (nx, ny, nz)
            before = u
            cosine = _dot(u, normal)
            cosine = keep(cosine, cosine > 0.0, MISSES_SURFACE)
            reach = (offset - _dot(x, normal)) / cosine
            reach = keep(reach, reach > 0.0, MISSES_SURFACE)
            dcosine = tuple(_dot(v, normal) for v in du)
            dx = tuple(
                _sum(d, -(_dot(d, normal) + reach * dc) / cosine, u, reach, v)
                for d, v, dc in zip(dx, du, dcosine, strict=True)
            )
            x = _sum(x, reach, u, 0.0, u)
            u, du = _refracted(u, du, normal, None, cosine, dcosine, ratio, trial)
        first, second = self._basis
        cosine = _dot(u, normal)
        gap = (target[0] - x[0], target[1] - x[1], target[2] - x[2])
        reach = _dot(gap, normal) / cosine
        missed = _sum((-gap[0], -gap[1], -gap[2]), reach, u, 0.0, u)
        moved = tuple(
            _sum(d, -(_dot(d, normal) + reach * _dot(v, normal)) / cosine, u, reach, v)
            for d, v in zip(dx, du, strict=True)
        )
        by = tuple((_dot(m, first), _dot(m, second)) for m in moved)
        return _Landing((_dot(missed, first), _dot(missed, second)), by, u, before, reach)  # type: ignore[arg-type]


def _refracted(
    u: Vector,
    du: tuple[Vector, ...],
    normal: Vector,
    turns: tuple[Vector, ...] | None,
    cosine: Component,
    dcosine: tuple[Component, ...],
    ratio: float,
    trial: Arithmetic,
) -> tuple[Vector, tuple[Vector, ...]]:
    """Snell's law for a ray and its derivatives; `turns` are those of a normal that turns."""
    root = trial.sqrt(1.0 - ratio * ratio * (1.0 - cosine * cosine))
    along = root - ratio * cosine
    bend = ratio * (ratio * cosine / root - 1.0)
    bent = []
    for i, (v, dc) in enumerate(zip(du, dcosine, strict=True)):
        turned = _sum((ratio * v[0], ratio * v[1], ratio * v[2]), bend * dc, normal, 0.0, normal)
        bent.append(turned if turns is None else _sum(turned, along, turns[i], 0.0, normal))
    straight = (ratio * u[0], ratio * u[1], ratio * u[2])
    return _sum(straight, along, normal, 0.0, normal), tuple(bent)


def _across(u: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors across a unit vector that points ahead (Duff et al. 2017)."""
    x, y, z = u
    a = -1.0 / (1.0 + z)
    b = x * y * a
    return (1.0 + x * x * a, b, -x), (b, 1.0 + y * y * a, -y)


def _unit(v: tuple[Component, ...], arithmetic: Arithmetic) -> Vector:
    x, y, z = v
    scale = 1.0 / arithmetic.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


def _dot(a: Vector, b: Vector) -> Component:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _sum(a: Vector, p: Component, b: Vector, q: Component, c: Vector) -> Vector:
    """Return a + p b + q c."""
    return (
        a[0] + p * b[0] + q * c[0],
        a[1] + p * b[1] + q * c[1],
        a[2] + p * b[2] + q * c[2],
    )


def _square(miss: tuple[Component, Component]) -> Component:
    return miss[0] * miss[0] + miss[1] * miss[1]


def _chosen(condition: Component, a: _Landing, b: _Landing, trial: Arithmetic) -> _Landing:
    """Return landing a where the condition holds, elsewhere b."""

    def pick(p: Component, q: Component) -> Component:
        if isinstance(p, tuple):
            return tuple(pick(i, j) for i, j in zip(p, q, strict=True))
        return trial.where(condition, p, q)

    return _Landing(*(pick(p, q) for p, q in zip(a, b, strict=True)))
