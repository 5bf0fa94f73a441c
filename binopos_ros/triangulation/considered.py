"""Errors of a rig that all pairs have in common, as rigs that have them.

They are considered, not estimated (Schmidt, NASA TN D-3107, 1966): a position's covariance holds
what they do to it, and no pair makes them smaller.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.evidence import STEP

Array = NDArray[np.float64]


def principal_errors(covariance: ArrayLike) -> Array:
    """Return independent errors (E, K) of one deviation each that make up the covariance (K, K).

    Raises:
        TriangulationError: it is no covariance.

    """
    given = np.array(covariance, dtype=np.float64)
    if given.ndim != 2 or given.shape[0] != given.shape[1] or not np.isfinite(given).all():
        msg = f'parameter covariance of shape {given.shape}: give (K, K) finite numbers'
        raise TriangulationError(msg)
    deviations = np.sqrt(np.maximum(np.diag(given), 0.0))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    values, vectors = np.linalg.eigh(given / np.outer(scale, scale))
    if not np.allclose(given, given.T) or values[0] < -1e-9:
        msg = 'parameter covariance is not symmetric and positive semidefinite'
        raise TriangulationError(msg)
    # Times the deviations, so that what is exact stays so to the last bit.
    return (vectors * np.sqrt(np.maximum(values, 0.0)) * deviations[:, None]).T[values > 1e-9]


def changed_rigs(rig: StereoRig, errors: Array) -> list[StereoRig]:
    """Return the rig with STEP of each of the errors (E, K)."""
    return [rig.perturbed(STEP * error) for error in errors]
