"""How far a calibration's own uncertainty carries on to positions: `calibration_covariances`."""

from __future__ import annotations

import numpy as np

from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState


def position_jacobians(state: RigState, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How a triangulated position follows the pixels and the calibration.

    A position minimises the reprojection error, so a change d of the parameters that moves the
    computed pixels by B d moves it by -(A^T A)^-1 A^T B d (A: pixels by position).

    Args:
        state: the rig.
        points: (N, 3) positions, rig frame (m).

    Returns:
        (N, 3, 4) by left u, v and right u, v (m/px) and (N, 3, P) by the parameters; nan where a
        camera does not see the point.
    """
    seen = [project(state, side, points) for side in (LEFT, RIGHT)]
    by_point = np.concatenate([s.by_point for s in seen], axis=1)
    by_rig = np.concatenate([s.by_rig for s in seen], axis=1)
    projected = np.swapaxes(by_point, 1, 2)
    normal = projected @ by_point
    good = np.isfinite(normal).all(axis=(1, 2)) & np.isfinite(by_rig).all(axis=(1, 2))
    by_pixels = np.full((len(points), 3, 4), np.nan)
    by_parameters = np.full((len(points), 3, by_rig.shape[2]), np.nan)
    by_pixels[good] = np.linalg.solve(normal[good], projected[good])
    by_parameters[good] = -by_pixels[good] @ by_rig[good]
    return by_pixels, by_parameters


def calibration_covariances(
    state: RigState, points: np.ndarray, covariance: ParameterCovariance
) -> np.ndarray:
    """(N, 3, 3) the positions' covariance that comes from the calibration alone (m^2)."""
    _, jacobian = position_jacobians(state, points)
    return jacobian @ covariance.ordered(state.names) @ np.swapaxes(jacobian, 1, 2)
