"""The image of a point behind a flat interface, with its derivatives by every parameter.

A camera at the origin sees the point Y through parallel layers as if it stood, in air, at the
same distance r from the normal through the camera but at another height h along it: the refracted
ray leaves the camera towards Y' = Y + (h - z) n with z = n.Y (the plane of incidence holds camera,
point and normal, erratum to Eq. 8-12). With the ray invariant s = n_i sin(theta_i) of Snell's law
(Eq. 8), c_i = sqrt(n_i^2 - s^2) and the layers' thicknesses t_i,

    r = s G(s),   h = c_0 G(s),   G(s) = sum_i t_i / c_i,

which is regular at s = 0. `optics` solves the first equation; the derivatives follow from it by
implicit differentiation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.optics.arithmetic import ARRAYS
from binopos_ros.optics.stack import ParallelStack


@dataclass(frozen=True)
class Apparent:
    """Where points seem to be, and how that changes.

    Attributes:
        points: (N, 3) on the refracted rays' straight continuation, camera frame (m); nan where
            the point does not lie behind the interface.
        by_point: (N, 3, 3) derivative by the true point.
        by_normal: (N, 3, 3) by the unit normal, to be applied to changes perpendicular to it.
        by_distance: (N, 3) by the distance of the first surface.
        by_indices: (N, 3, L) by the index of each medium but the first.
        by_thicknesses: (N, 3, L - 1) by the thickness of each layer in between.
    """

    points: np.ndarray
    by_point: np.ndarray
    by_normal: np.ndarray
    by_distance: np.ndarray
    by_indices: np.ndarray
    by_thicknesses: np.ndarray


def apparent_points(
    points: np.ndarray,
    normal: np.ndarray,
    distance: float,
    indices: Sequence[float],
    thicknesses: Sequence[float] = (),
) -> Apparent:
    """Solve the refracted rays from the origin to `points` (N, 3), all in the camera frame (m).

    The arguments are those of `optics.FlatInterface`.
    """
    index = np.asarray(indices, float)
    z = points @ normal
    lateral = points - z[:, None] * normal
    r = np.sqrt(np.sum(lateral**2, axis=1))
    across = lateral / np.where(r > 0, r, 1.0)[:, None]
    last = z - distance - float(np.sum(thicknesses))
    layers = np.empty((len(points), len(index)))
    layers[:, 0] = distance
    layers[:, 1:-1] = thicknesses
    layers[:, -1] = np.where((last > 0) & (distance > 0), last, np.nan)

    stack = ParallelStack(tuple(index), (distance, *thicknesses))
    with np.errstate(all='ignore'):
        tangent = r * stack.slope(r * r, layers[:, -1], ARRAYS)
    s = index[0] * tangent / np.sqrt(1.0 + tangent**2)
    cosine = np.sqrt(index**2 - s[:, None] ** 2)
    gain = np.sum(layers / cosine, axis=1)
    height = cosine[:, 0] * gain

    # F(s) = s G(s) - r = 0 gives ds by r, by t_i and by n_i.
    slope = np.sum(layers * index**2 / cosine**3, axis=1)
    height_by_s = -s / cosine[:, 0] * gain + cosine[:, 0] * s * np.sum(layers / cosine**3, axis=1)
    by_r = height_by_s / slope
    by_layer = (cosine[:, :1] - by_r[:, None] * s[:, None]) / cosine
    by_index = layers * index / cosine**3 * (by_r[:, None] * s[:, None] - cosine[:, :1])
    by_z = by_layer[:, -1]

    apparent = points + (height - z)[:, None] * normal
    by_point = (
        np.eye(3)
        + normal[:, None] * (by_r[:, None] * across + (by_z - 1.0)[:, None] * normal)[:, None, :]
    )
    # A change dn of the normal changes z by r (across.dn), and r by -z (across.dn).
    by_normal = (height - z)[:, None, None] * np.eye(3) + normal[:, None] * (
        (r * by_z - r - z * by_r)[:, None] * across
    )[:, None, :]
    along = normal[None, :, None]
    return Apparent(
        points=apparent,
        by_point=by_point,
        by_normal=by_normal,
        by_distance=(by_layer[:, 0] - by_z)[:, None] * normal,
        by_indices=along * by_index[:, None, 1:],
        by_thicknesses=along * (by_layer[:, 1:-1] - by_z[:, None])[:, None, :],
    )
