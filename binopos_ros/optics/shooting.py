"""A ray traced forwards with its derivatives: what a pixel owes to the point and the surfaces.

A ray leaves the camera along (a, b, 1), is bent at each surface and lands on a plane through the
target: one parallel to the last surface or, beyond a sphere, one across the ray. Carrying its
derivatives along (with respect to a, b, and every parameter of the surfaces) and asking that it
still lands on the target gives, by the implicit function theorem, the derivatives of (a, b).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.surfaces import Surfaces

FloatArray = NDArray[np.float64]


def image_plane_jacobian(
    surfaces: Surfaces, a: FloatArray, b: FloatArray, targets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Differentiate the image-plane coordinates of targets.

    Args:
        surfaces: at least one.
        a: (N,) image-plane coordinates of the targets, nan where they have none.
        b: (N,) the same.
        targets: (N, 3) of the camera frame, m.

    Returns:
        (N, 2, 3) with respect to the target, 1/m, and (N, 2, K) with respect to the parameters, in
        the order of `surfaces.seeds.names`.

    """
    position, tangent, u = _shoot(surfaces, a, b)
    if surfaces.planes:
        normal, basis = surfaces.normals[-1], surfaces.bases[-1]
    else:
        normal, basis = u, _across(u)
    cosine = (u * normal).sum(axis=1)
    reach = ((targets - position) * normal).sum(axis=1) / cosine
    dreach = (
        -(_along(normal, tangent[0]) + reach[:, None] * _along(normal, tangent[1]))
        / cosine[:, None]
    )
    landing = tangent[0] + dreach[:, None, :] * u[:, :, None]
    landing = basis @ (landing + reach[:, None, None] * tangent[1])
    # Moving the target along the ray changes nothing.
    slide = np.eye(3) - u[:, :, None] * (normal / cosine[:, None])[:, None, :]
    by_pixel = landing[:, :, :2]
    lost = ~np.isfinite(by_pixel).all(axis=(1, 2))
    by_pixel[lost] = np.eye(2)
    inverse = np.linalg.inv(by_pixel)
    inverse[lost] = np.nan
    return inverse @ (basis @ slide), -inverse @ landing[:, :, 2:]


def _shoot(
    surfaces: Surfaces, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray], FloatArray]:
    """Return where rays leave the last surface, their tangents, and their directions.

    The tangents are those of position and direction, (N, 3, 2 + K) each.
    """
    seeds = surfaces.seeds
    u = np.stack([a, b, np.ones_like(a)], axis=-1)
    length = np.linalg.norm(u, axis=-1)
    u /= length[:, None]
    count = 2 + len(seeds.names)
    du = np.zeros((len(a), 3, count))
    du[:, :, :2] = (np.eye(3) - u[:, :, None] * u[:, None, :])[:, :, :2] / length[:, None, None]
    x, dx = np.zeros_like(u), np.zeros_like(du)
    for j, (px, py, pz, extent, ratio) in enumerate((*surfaces.spheres, *surfaces.planes)):
        # How this surface moves, grows and refracts with a, b and the parameters.
        move, grow, dratio = np.zeros((3, count)), np.zeros(count), np.zeros(count)
        move[:, 2:], grow[2:] = seeds.vectors[j], seeds.extents[j]
        dratio[2:] = seeds.indices[j] - ratio * seeds.indices[j + 1]
        dratio /= surfaces.indices[j + 1]
        vector = np.array([px, py, pz])
        if j < len(surfaces.spheres):
            from_centre, dfrom = x - vector, dx - move
            along = (from_centre * u).sum(axis=1)
            half = np.sqrt(extent * extent - (from_centre * from_centre).sum(axis=1) + along**2)
            dalong = _along(u, dfrom) + _along(from_centre, du)
            dhalf = extent * grow - _along(from_centre, dfrom) + along[:, None] * dalong
            dhalf = dhalf / half[:, None]
            x, dx = _advanced(x, dx, u, du, half - along, dhalf - dalong)
            normal = (x - vector) / extent
            turn = (dx - move - normal[:, :, None] * grow) / extent
            cosine, dcosine = half / extent, (dhalf - (half / extent)[:, None] * grow) / extent
        else:
            normal, turn = vector, move
            cosine, dcosine = u @ normal, normal @ du + u @ turn
            reach = (extent - x @ normal) / cosine
            dreach = grow - normal @ dx - x @ turn - reach[:, None] * dcosine
            x, dx = _advanced(x, dx, u, du, reach, dreach / cosine[:, None])
        sine2 = 1.0 - cosine * cosine
        root = np.sqrt(1.0 - ratio * ratio * sine2)
        droot = (ratio * ratio * cosine)[:, None] * dcosine - (ratio * sine2)[:, None] * dratio
        droot = droot / root[:, None]
        along = root - ratio * cosine
        dalong = droot - cosine[:, None] * dratio - ratio * dcosine
        du = ratio * du + u[:, :, None] * dratio + normal[..., None] * dalong[:, None, :]
        du = du + along[:, None, None] * turn
        u = ratio * u + along[:, None] * normal
    return x, (dx, du), u


def _advanced(
    x: FloatArray,
    dx: FloatArray,
    u: FloatArray,
    du: FloatArray,
    reach: FloatArray,
    dreach: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return points moved along their rays, with their tangents."""
    moved = dx + dreach[:, None, :] * u[:, :, None] + reach[:, None, None] * du
    return x + reach[:, None] * u, moved


def _along(vectors: FloatArray, tangents: FloatArray) -> FloatArray:
    """Return the products of vectors (N, 3), or one (3,), with tangents (N, 3, K): (N, K)."""
    products: FloatArray = (vectors[..., None] * tangents).sum(axis=1)
    return products


def _across(u: FloatArray) -> FloatArray:
    """Return two unit vectors across each of (N, 3), as rows of (N, 2, 3) (Duff et al. 2017)."""
    x, y, z = u.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return np.stack([first, np.stack([b, sign + y * y * a, -y], axis=-1)], axis=1)
