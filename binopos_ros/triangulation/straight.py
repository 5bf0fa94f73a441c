"""Triangulation along straight rays, as if there were no surface (Eq. 6-7, mended)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.arithmetic import ARRAYS
from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.rig import StereoRig
from binopos_ros.triangulation.meeting import PARALLEL, midpoint

FloatArray = NDArray[np.float64]

NO_RAY = "the pixel lies beyond the lens's field"
BEHIND = 'the rays meet behind the cameras'


def triangulate_straight(
    rig: StereoRig,
    left_px: FloatArray,
    right_px: FloatArray,
    left_cov: FloatArray,
    right_cov: FloatArray,
) -> tuple[FloatArray, FloatArray, NDArray[np.object_]]:
    """Return the middle of the shortest segment between the straight rays.

    The point minimises the summed squared distances to the two rays, so with P the projections
    across them (P_left + P_right) X = P_left C_left + P_right C_right; differentiating this by the
    rays carries the pixels' covariances over to the point.

    Args:
        rig: its surfaces are ignored.
        left_px: (N, 2) px, finite.
        right_px: (N, 2) px, finite.
        left_cov: (N, 2, 2) px^2.
        right_cov: (N, 2, 2) px^2.

    Returns:
        points (N, 3) m and covariances (N, 3, 3) m^2 in the rig frame, nan where there is none,
        and reasons (N,).

    """
    rotation, centre = rig.rotation, -rig.rotation.T @ rig.translation
    left, left_by_px = _rays(rig.left, left_px)
    right, right_by_px = _rays(rig.right, right_px)
    right, right_by_px = right @ rotation, rotation.T @ right_by_px
    origin = (0.0, 0.0, 0.0)
    with np.errstate(all='ignore'):
        ends = (origin, tuple(left.T)), (tuple(centre.tolist()), tuple(right.T))
        middle, (s, t) = midpoint(*ends, ARRAYS)  # type: ignore[arg-type]
    points = np.stack(middle, axis=-1)
    known = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    reasons = np.select(
        [~known, np.isnan(s), ~((s > 0.0) & (t > 0.0))], [NO_RAY, PARALLEL, BEHIND], default=''
    ).astype(object)
    points[reasons != ''] = np.nan

    by_left = _by_direction(left, left, right, points)
    by_right = _by_direction(right, left, right, points - centre)
    covariances = sum(
        by @ cov @ np.swapaxes(by, 1, 2)
        for by, cov in ((by_left @ left_by_px, left_cov), (by_right @ right_by_px, right_cov))
    )
    return points, covariances, reasons


def _rays(camera: PinholeCamera, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit rays (N, 3) and their derivatives by the pixel, (N, 3, 2)."""
    with np.errstate(all='ignore'):
        x, y = camera.image_plane(pixels[:, 0], pixels[:, 1])
        ray = np.stack([x, y, np.ones_like(x)], axis=-1)
        length = np.linalg.norm(ray, axis=1)
        ray /= length[:, None]
        _, _, ux, uy, vx, vy = camera.pixels_with_jacobian(x, y)
        determinant = ux * vy - uy * vx
        by_pixel = np.empty((len(x), 2, 2))
        by_pixel[:, 0, 0], by_pixel[:, 0, 1] = vy / determinant, -uy / determinant
        by_pixel[:, 1, 0], by_pixel[:, 1, 1] = -vx / determinant, ux / determinant
    across = np.eye(3) - ray[:, :, None] * ray[:, None, :]
    return ray, across[:, :, :2] @ by_pixel / length[:, None, None]


def _by_direction(
    ray: FloatArray, left: FloatArray, right: FloatArray, offset: FloatArray
) -> FloatArray:
    """Return d(point)/d(ray), (N, 3, 3); offset (N, 3) is the point seen from the ray's centre."""
    system = 2.0 * np.eye(3) - sum(d[:, :, None] * d[:, None, :] for d in (left, right))
    lost = ~np.isfinite(offset).all(axis=1)
    system[lost] = np.eye(3)
    along = np.einsum('ni,ni->n', ray, offset)
    change = ray[:, :, None] * offset[:, None, :] + along[:, None, None] * np.eye(3)
    return np.linalg.solve(system, change)
