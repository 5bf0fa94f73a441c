"""What one pair of images says about the refractive index, with the target's position eliminated.

A pair gives four numbers and a point takes three. With the residuals r of the best point at an
assumed index, whitened by the pixels' covariances, and the whitened derivatives J (by the point)
and g (by the index),

    p = g - J (J'J)^-1 J'g,    a = |p|,    e = p'r / a = a (n - n_assumed) + noise of variance 1

The point is gone, and a^2 is the pair's Fisher information on n. It vanishes for a target equally
far (along the interface) from both cameras, and for one in the plane of both camera centres and
the normal; to first order e is independent of the noise of the point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import FlatInterface, StereoRig
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.paper import triangulate_paper

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Clue:
    """innovation = gain (n - n_assumed) + shared . considered + noise of variance 1.

    `shared` (k,) belongs to parameters whose errors all pairs have in common.
    """

    innovation: float
    gain: float
    shared: Array


@dataclass(frozen=True)
class Evidence:
    """One pair, linearised at an assumed index.

    Attributes:
        at: the assumed index.
        reason: '' or why there is no point; then the rest is nan.
        clue: what the disagreement of the two rays says about the index.
        point: (3,) the best point at the assumed index, rig frame, m.
        covariance: (3,3) of the point at that index, m^2.
        by_index: (3,) change of the point with the index, m.
        by_shared: (3,k) change of the point with the considered parameters.
    """

    at: float
    reason: str
    clue: Clue
    point: Array
    covariance: Array
    by_index: Array
    by_shared: Array


def gather_evidence(
    rig: StereoRig,
    index: float,
    left_px: ArrayLike,
    right_px: ArrayLike,
    left_cov: ArrayLike | None = None,
    right_cov: ArrayLike | None = None,
) -> Evidence:
    """Triangulate one pair at an assumed index and tell how far and how surely that is off.

    Args:
        rig: cameras and interface; `index` replaces the index of the target's medium.
        index: assumed.
        left_px, right_px: (2,) pixels.
        left_cov, right_cov: (2,2) px^2.
    """
    rig = _with_index(rig, index)
    z = np.r_[np.ravel(left_px), np.ravel(right_px)].astype(float)
    points, reasons = triangulate_paper(rig, z[:2], z[2:])
    if reasons[0]:
        return _no_point(index, str(reasons[0]))
    whiten = np.zeros((4, 4))
    for block, given in ((slice(0, 2), left_cov), (slice(2, 4), right_cov)):
        cov = np.eye(2) if given is None else np.asarray(given, dtype=float)
        whiten[block, block] = np.linalg.inv(np.linalg.cholesky(cov))
    point, h = points[0], 1e-6
    for _ in range(6):
        stencil = np.vstack([point, point + h * np.eye(3), point - h * np.eye(3)])
        images = np.hstack(rig.project(stencil))
        J = whiten @ (images[1:4] - images[4:7]).T / (2 * h)
        r = whiten @ (z - images[0])
        covariance = np.linalg.inv(J.T @ J)
        step = covariance @ J.T @ r
        point = point + step
        if np.abs(step).max() < 1e-9:
            break
    up, down = (np.hstack(_with_index(rig, index + s).project(point)) for s in (h, -h))
    g = whiten @ (up - down) / (2 * h)
    by_index = -covariance @ J.T @ g
    p = g + J @ by_index
    gain = float(np.sqrt(p @ p))
    r = r - J @ step
    clue = Clue(float(p @ r / gain) if gain > 0 else 0.0, gain, np.zeros(0))
    return Evidence(index, '', clue, point, covariance, by_index, np.zeros((3, 0)))


def _no_point(index: float, reason: str) -> Evidence:
    nowhere = np.full(3, math.nan)
    unknown, shared = np.full((3, 3), math.nan), np.zeros((3, 0))
    return Evidence(index, reason, Clue(0.0, 0.0, np.zeros(0)), nowhere, unknown, nowhere, shared)


def _with_index(rig: StereoRig, index: float) -> StereoRig:
    interface = rig.interface
    if interface is None:
        msg = 'the rig has no interface, so there is no index to estimate'
        raise TriangulationError(msg)
    return StereoRig(
        rig.left,
        rig.right,
        rig.rotation,
        rig.translation,
        FlatInterface(
            interface.normal,
            interface.distance,
            (*interface.indices[:-1], index),
            interface.thicknesses,
        ),
    )
