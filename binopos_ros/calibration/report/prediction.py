"""How good positions will be: pixels' noise and the calibration's own uncertainty together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.adjustment.positions import position_jacobians
from binopos_ros.calibration.views.pose import Pose
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState

TARGET_SIGMA = 0.1  # px, of a target's centre
ACROSS, ALONG = 41, 31  # of the map


@dataclass(frozen=True)
class ErrorMap:
    """A level slice through the working volume, at the height of its middle.

    Attributes:
        x: (ACROSS,) and z: (ALONG,) in the rig frame (m).
        total: (ALONG, ACROSS) standard deviation of a position's length (m), nan where a camera
            does not see it.
        calibration: the part that comes from the calibration.
    """

    x: np.ndarray
    z: np.ndarray
    total: np.ndarray
    calibration: np.ndarray

    @property
    def median(self) -> float:
        """Over what both cameras see (m)."""
        return float(np.nanmedian(self.total))


def predicted_errors(
    state: RigState,
    covariance: np.ndarray,
    points: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) standard deviations of positions' lengths (m), in all and from the calibration alone.

    Args:
        state: the rig; covariance: (P, P) of its parameters.
        points: (N, 3) rig frame (m).
    """
    by_pixels, by_parameters = position_jacobians(state, points)
    pixels = TARGET_SIGMA**2 * np.sum(by_pixels**2, axis=(1, 2))
    calibration = np.einsum('nij,jk,nik->n', by_parameters, covariance, by_parameters)
    return np.sqrt(pixels + calibration), np.sqrt(np.maximum(calibration, 0.0))


def error_map(
    state: RigState,
    covariance: np.ndarray,
    views: Sequence[View],
    poses: Sequence[Pose],
) -> ErrorMap:
    """Predict over the volume in which the boards were."""
    seen = np.concatenate([pose.apply(v.points) for v, pose in zip(views, poses, strict=True)])
    low, high = seen.min(axis=0), seen.max(axis=0)
    margin = 0.1 * (high - low)
    x = np.linspace(low[0] - margin[0], high[0] + margin[0], ACROSS)
    z = np.linspace(max(low[2], 1e-3), high[2] + margin[2], ALONG)
    grid = np.stack(np.meshgrid(x, z), axis=-1)
    points = np.column_stack(
        [grid[..., 0].ravel(), np.full(grid[..., 0].size, seen[:, 1].mean()), grid[..., 1].ravel()]
    )
    total, calibration = predicted_errors(state, covariance, points)
    outside = ~in_both_pictures(state, points)
    total[outside] = np.nan
    calibration[outside] = np.nan
    return ErrorMap(x, z, total.reshape(ALONG, ACROSS), calibration.reshape(ALONG, ACROSS))


def in_both_pictures(state: RigState, points: np.ndarray) -> np.ndarray:
    """(N,) which points both cameras have in their pictures."""
    inside = np.ones(len(points), bool)
    for side, pixels in zip((LEFT, RIGHT), state.rig().project(points), strict=True):
        width, height = state.cameras[side].size
        with np.errstate(invalid='ignore'):
            inside &= (pixels >= 0).all(axis=1) & (pixels[:, 0] < width) & (pixels[:, 1] < height)
    return inside
