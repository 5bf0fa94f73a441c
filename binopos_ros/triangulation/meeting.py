"""Where two rays all but meet: the middle of the shortest segment between them (Eq. 6-7 mended).

The paper's single scale for both rays holds for parallel cameras alone; one scale per ray holds
always and is the same there.
"""

from __future__ import annotations

from binopos_ros.optics.arithmetic import Arithmetic, Component

Vector = tuple[Component, Component, Component]
Ray = tuple[Vector, Vector]  # a point on it, m, and its unit direction

PARALLEL_SINE = 1e-9  # below this rounding alone decides where two rays meet
PARALLEL = 'the rays are parallel'


def dot(a: Vector, b: Vector) -> Component:
    """Return the scalar product of two vectors given by components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def midpoint(
    left: Ray, right: Ray, arithmetic: Arithmetic
) -> tuple[Vector, tuple[Component, Component]]:
    """Return the middle of the shortest segment between two rays, and its two scales, m.

    A scale is the distance from the ray's point along its direction; parallel rays are not kept.
    """
    (start, u), (other, v) = left, right
    gap = (other[0] - start[0], other[1] - start[1], other[2] - start[2])
    cosine = dot(u, v)
    cross = (
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    )
    sine2 = dot(cross, cross)
    sine2 = arithmetic.keep(sine2, sine2 > PARALLEL_SINE * PARALLEL_SINE, PARALLEL)
    along_left, along_right = dot(u, gap), dot(v, gap)
    s = (along_left - cosine * along_right) / sine2
    t = (cosine * along_left - along_right) / sine2
    middle = (
        0.5 * (start[0] + s * u[0] + other[0] + t * v[0]),
        0.5 * (start[1] + s * u[1] + other[1] + t * v[1]),
        0.5 * (start[2] + s * u[2] + other[2] + t * v[2]),
    )
    return middle, (s, t)
