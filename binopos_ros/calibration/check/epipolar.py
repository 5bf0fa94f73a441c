"""The one number in four that a position cannot absorb: how far two bent rays miss each other.

At the best position the four pixel residuals are perpendicular to the position's three columns.
What is left along the fourth direction is the epipolar residual along the bent rays.
"""

from __future__ import annotations

import numpy as np

from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState


def epipolar_residuals(
    state: RigState, points: np.ndarray, residuals: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Epipolar residuals, and how they follow the rig's parameters.

    Args:
        state: the rig.
        points: (N, 3) positions near the best ones, rig frame (m).
        residuals: (N, 4) measured minus computed: left u, v, right u, v (px).

    Returns:
        (N,) px, positive where the left picture shows the point lower than the right one allows;
        (N, P) its derivatives by the parameters.
    """
    seen = [project(state, side, points) for side in (LEFT, RIGHT)]
    by_point = np.concatenate([one.by_point for one in seen], axis=1)
    by_rig = np.concatenate([one.by_rig for one in seen], axis=1)
    across = np.linalg.svd(by_point)[0][:, :, 3]
    across = across * np.where(across[:, 1:2] < 0.0, -1.0, 1.0)
    return np.einsum('nk,nk->n', across, residuals), np.einsum('nk,nkp->np', across, by_rig)
