"""The maximum-likelihood points of many pairs, along the bent rays (see `likelihood.py`)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.arithmetic import ARRAYS, FLOATS, Component, NoRayError
from binopos_ros.optics.batches import in_blocks
from binopos_ros.optics.rig import StereoRig
from binopos_ros.triangulation.likelihood import (
    SETTLED,
    Fit,
    Pair,
    Symmetric,
    colour,
    covariance_terms,
    fit_block,
    fit_point,
    whitening,
)
from binopos_ros.triangulation.meeting import Vector
from binopos_ros.triangulation.result import NOT_FINITE, Triangulation, no_points

FloatArray = NDArray[np.float64]


def triangulate_refractive(
    rig: StereoRig,
    left_px: FloatArray,
    right_px: FloatArray,
    left_cov: FloatArray,
    right_cov: FloatArray,
) -> Triangulation:
    """Fit every pair: one on floats, many in blocks whose odd pairs are then fitted on floats.

    Args:
        rig: cameras and surfaces.
        left_px: (N, 2) px.
        right_px: (N, 2) px.
        left_cov: (N, 2, 2) px^2.
        right_cov: (N, 2, 2) px^2.

    """

    def one(i: int) -> Triangulation:
        covs = left_cov[i].ravel().tolist(), right_cov[i].ravel().tolist()
        return _single(rig, left_px[i].tolist(), right_px[i].tolist(), *covs)

    if len(left_px) == 1:
        return one(0)
    found = no_points(len(left_px))

    def work(block: slice) -> None:
        observed = np.ascontiguousarray(np.hstack([left_px[block], right_px[block]]).T)
        with np.errstate(all='ignore'):
            pair = Pair(
                (observed[0], observed[1]),
                (observed[2], observed[3]),
                whitening(covariance_terms(left_cov[block]), 'left', ARRAYS),
                whitening(covariance_terms(right_cov[block]), 'right', ARRAYS),
            )
            fit = fit_block(rig, pair)
            odd = np.flatnonzero(~(fit.decrement <= SETTLED))
        for i in range(3):
            found.points[block, i] = fit.point[i]
        for i, row in enumerate(_square(fit.covariance)):
            for j, term in enumerate(row):
                found.covariances[block, i, j] = term
        for i, term in enumerate(_pixel_residuals(fit, pair)):
            found.residuals[block, i] = term
        for i in odd + block.start:
            _put(found, i, one(i))

    in_blocks(work, len(left_px))
    return found


def _single(
    rig: StereoRig,
    left: list[float],
    right: list[float],
    left_cov: list[float],
    right_cov: list[float],
) -> Triangulation:
    """Fit one pair on plain floats, or say why there is no point."""
    if not all(map(math.isfinite, (*left, *right, *left_cov, *right_cov))):
        return no_points(1, NOT_FINITE)
    try:
        pair = Pair(
            (left[0], left[1]),
            (right[0], right[1]),
            whitening(left_cov, 'left', FLOATS),
            whitening(right_cov, 'right', FLOATS),
        )
        fit = fit_point(rig, pair)
    except NoRayError as no_ray:
        return no_points(1, str(no_ray))
    return Triangulation(
        np.array([fit.point]),
        np.array([_square(fit.covariance)]),
        np.array([_pixel_residuals(fit, pair)]),
        np.array([''], dtype=object),
    )


def _square(terms: Symmetric) -> tuple[Vector, Vector, Vector]:
    xx, xy, xz, yy, yz, zz = terms
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def _pixel_residuals(fit: Fit, pair: Pair) -> tuple[Component, ...]:
    left = colour((fit.residual[0], fit.residual[1]), pair.left_whitening)
    right = colour((fit.residual[2], fit.residual[3]), pair.right_whitening)
    return (*left, *right)


def _put(found: Triangulation, i: int, one: Triangulation) -> None:
    found.points[i], found.covariances[i] = one.points[0], one.covariances[0]
    found.residuals[i], found.reasons[i] = one.residuals[0], one.reasons[0]
