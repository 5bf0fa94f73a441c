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
from collections.abc import Sequence
from dataclasses import dataclass
from operator import mul

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.optics.arithmetic import FLOATS, NoRayError
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.likelihood import Pair, Whitening, colour, fit_point, whitening
from binopos_ros.triangulation.meeting import dot
from binopos_ros.triangulation.result import NOT_FINITE

Array = NDArray[np.float64]

#: Step of the considered parameters, in their standard deviations, for their derivatives.
STEP = 0.01


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
        residuals: (4,) observed minus predicted, px: left u, v, right u, v.
    """

    at: float
    reason: str
    clue: Clue
    point: Array
    covariance: Array
    by_index: Array
    by_shared: Array
    residuals: Array


def gather_evidence(
    rig: StereoRig,
    left_px: ArrayLike,
    right_px: ArrayLike,
    left_cov: ArrayLike | None = None,
    right_cov: ArrayLike | None = None,
    changes: Sequence[StereoRig] = (),
    calibration_std: float = 0.0,
    near: tuple[float, float, float] | None = None,
) -> Evidence:
    """Triangulate one pair at the rig's index, and tell how far and how surely that is off.

    Args:
        rig: cameras and surfaces; its `target_index` is the assumed index.
        left_px: (2,) px.
        right_px: (2,) px.
        left_cov: (2,2) px^2.
        right_cov: (2,2) px^2.
        changes: the rig with one considered parameter changed by STEP of its standard deviation,
            for each of them.
        calibration_std: px; above 0 it adds four considered parameters: what the calibration
            puts all left u, left v, right u and right v beside where they belong.
        near: about where the point is, m, where that is known.

    Raises:
        TriangulationError, OpticsError: as `triangulate` raises them.
    """
    index = rig.target_index
    if index is None:
        msg = 'the rig looks through no surface, so there is no index to estimate'
        raise TriangulationError(msg)
    left, right = _numbers(left_px, 2, 'left_px'), _numbers(right_px, 2, 'right_px')
    covariances = _covariance(left_cov, 'left_cov'), _covariance(right_cov, 'right_cov')
    count = len(changes) + (4 if calibration_std > 0.0 else 0)
    if not all(map(math.isfinite, (*left, *right, *covariances[0], *covariances[1]))):
        return _no_point(index, NOT_FINITE, count)
    try:
        whiten_left = whitening(covariances[0], 'left', FLOATS)
        whiten_right = whitening(covariances[1], 'right', FLOATS)
        pair = Pair((left[0], left[1]), (right[0], right[1]), whiten_left, whiten_right)
        fit = fit_point(rig, pair, near)
        changed = [[view.pixel(fit.point, FLOATS) for view in other.views] for other in changes]
    except NoRayError as no_ray:
        return _no_point(index, str(no_ray), count)

    linear = fit.linear
    left_over = [
        by_index + dot(row, fit.by_index)
        for by_index, row in zip(linear.by_index, linear.rows, strict=True)
    ]
    gain = math.sqrt(sum(p * p for p in left_over))
    direction = [p / gain for p in left_over] if gain > 0.0 else [0.0] * 4
    xx, xy, xz, yy, yz, zz = fit.covariance
    covariance = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    residuals = np.array(
        [*colour(fit.residual[:2], whiten_left), *colour(fit.residual[2:], whiten_right)]
    )
    shared, by_shared = np.zeros(0), np.zeros((3, 0))
    if count:
        whiten = _block_diagonal(whiten_left, whiten_right)
        whitened = np.empty((4, count))
        if changes:
            images = np.array([*left, *right]) - residuals
            shifts = np.array(changed).reshape(-1, 4) - images
            whitened[:, : len(changes)] = whiten @ (shifts / STEP).T
        whitened[:, len(changes) :] = calibration_std * whiten[:, : count - len(changes)]
        shared = direction @ whitened
        by_shared = -covariance @ (np.array(linear.rows).T @ whitened)
    return Evidence(
        at=index,
        reason='',
        clue=Clue(sum(map(mul, direction, fit.residual)), gain, shared),
        point=np.array(fit.point),
        covariance=covariance,
        by_index=np.array(fit.by_index),
        by_shared=by_shared,
        residuals=residuals,
    )


def _block_diagonal(left: Whitening, right: Whitening) -> Array:
    whiten = np.zeros((4, 4))
    for first, (l11, l21, l22) in ((0, left), (2, right)):
        whiten[first, first], whiten[first + 1, first + 1] = l11, l22
        whiten[first + 1, first] = l21
    return whiten


def _numbers(values: ArrayLike, count: int, what: str) -> list[float]:
    array = np.asarray(values, dtype=np.float64)
    if array.size != count:
        msg = f'{what} has the shape {array.shape}: the index takes one pair at a time'
        raise TriangulationError(msg)
    numbers: list[float] = array.ravel().tolist()
    return numbers


def _covariance(values: ArrayLike | None, what: str) -> list[float]:
    return [1.0, 0.0, 0.0, 1.0] if values is None else _numbers(values, 4, what)


def _no_point(index: float, reason: str, count: int) -> Evidence:
    nowhere, unknown = np.full(3, math.nan), np.full((3, 3), math.nan)
    clue = Clue(0.0, 0.0, np.zeros(count))
    shared, nothing = np.zeros((3, count)), np.full(4, math.nan)
    return Evidence(index, reason, clue, nowhere, unknown, nowhere, shared, nothing)
