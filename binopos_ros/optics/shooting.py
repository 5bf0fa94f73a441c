"""A ray traced forwards with its derivatives: what a pixel owes to the point and the surfaces.

A ray leaves the camera along (a, b, 1), is bent at each plane and lands on the plane through the
target that is parallel to the last surface. Carrying its derivatives along (with respect to a, b,
and every parameter of the surfaces) and asking that it still lands on the target gives, by the
implicit function theorem, the derivatives of (a, b).
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
        surfaces: at least one plane.
        a: (N,) image-plane coordinates of the targets, nan where they have none.
        b: (N,) the same.
        targets: (N, 3) of the camera frame, m.

    Returns:
        (N, 2, 3) with respect to the target, 1/m, and (N, 2, K) with respect to the parameters, in
        the order of `surfaces.seeds.names`.

    """
    position, tangent, u = _shoot(surfaces, a, b)
    normal = surfaces.normals[-1]
    cosine = u @ normal
    reach = (targets - position) @ normal / cosine
    dreach = -(normal @ tangent[0] + reach[:, None] * (normal @ tangent[1])) / cosine[:, None]
    landing = tangent[0] + dreach[:, None, :] * u[:, :, None]
    landing = surfaces.bases[-1] @ (landing + reach[:, None, None] * tangent[1])
    # Moving the target along the ray changes nothing.
    slide = np.eye(3) - u[:, :, None] * (normal / cosine[:, None])[:, None, :]
    by_pixel = landing[:, :, :2]
    lost = ~np.isfinite(by_pixel).all(axis=(1, 2))
    by_pixel[lost] = np.eye(2)
    inverse = np.linalg.inv(by_pixel)
    inverse[lost] = np.nan
    return inverse @ (surfaces.bases[-1] @ slide), -inverse @ landing[:, :, 2:]


def _shoot(
    surfaces: Surfaces, a: FloatArray, b: FloatArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray], FloatArray]:
    """Return where rays leave the last plane, their tangents, and their directions.

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
    for j, normal in enumerate(surfaces.normals):
        # How this plane turns, shifts and refracts with a, b and the parameters.
        turn, shift, dratio = np.zeros((3, count)), np.zeros(count), np.zeros(count)
        turn[:, 2:], shift[2:] = seeds.normals[j], seeds.offsets[j]
        ratio = surfaces.indices[j] / surfaces.indices[j + 1]
        dratio[2:] = seeds.indices[j] - ratio * seeds.indices[j + 1]
        dratio /= surfaces.indices[j + 1]
        cosine, dcosine = u @ normal, normal @ du + u @ turn
        reach = (surfaces.offsets[j] - x @ normal) / cosine
        dreach = (shift - normal @ dx - x @ turn - reach[:, None] * dcosine) / cosine[:, None]
        x = x + reach[:, None] * u
        dx = dx + dreach[:, None, :] * u[:, :, None] + reach[:, None, None] * du
        sine2 = 1.0 - cosine * cosine
        root = np.sqrt(1.0 - ratio * ratio * sine2)
        droot = (ratio * ratio * cosine)[:, None] * dcosine - (ratio * sine2)[:, None] * dratio
        droot = droot / root[:, None]
        along = root - ratio * cosine
        dalong = droot - cosine[:, None] * dratio - ratio * dcosine
        du = ratio * du + u[:, :, None] * dratio + normal[:, None] * dalong[:, None, :]
        du = du + along[:, None, None] * turn
        u = ratio * u + along[:, None] * normal
    return x, (dx, du), u
