"""From a pair of pixels to a point with its covariance: the door to this room's methods."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import ARRAYS
from binopos_ros.optics.rig import StereoRig
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.likelihood import (
    covariance_terms,
    not_positive_definite,
    whitening,
)
from binopos_ros.triangulation.paper import triangulate_paper
from binopos_ros.triangulation.refractive import triangulate_refractive
from binopos_ros.triangulation.result import NOT_FINITE, Triangulation, no_points
from binopos_ros.triangulation.straight import triangulate_straight

FloatArray = NDArray[np.float64]

NUDGE = 1e-3  # px, to differentiate the paper's method by its pixels
AT_THE_EDGE = 'a thousandth of a pixel further there is no point'

Method = Callable[[StereoRig, FloatArray, FloatArray, FloatArray, FloatArray], Triangulation]


def triangulate(
    rig: StereoRig,
    left_px: ArrayLike,
    right_px: ArrayLike,
    left_cov: ArrayLike | None = None,
    right_cov: ArrayLike | None = None,
    method: str = 'refractive',
    parameter_covariance: ArrayLike | None = None,
) -> Triangulation:
    """Triangulate pairs of pixels.

    Args:
        rig: cameras and surfaces.
        left_px: (N, 2) or (2,).
        right_px: the same.
        left_cov: covariance of the left pixels, (N, 2, 2) or one (2, 2) for all, px^2; the
            identity where it is not given.
        right_cov: the same.
        method: 'refractive', the maximum-likelihood point along the bent rays; 'paper', the
            paper's corrected method; 'straight', as if there were no surface.
        parameter_covariance: (K, K) of the surfaces' parameters, in the order of
            `rig.parameter_names`: adds what their uncertainty does to the points ('refractive').

    Raises:
        TriangulationError: an unknown method, or shapes that do not fit.

    Examples:
        >>> from binopos_ros.optics import FlatInterface, PinholeCamera
        >>> camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
        >>> water = FlatInterface((0, 0, 1), 0.8, (1.0, 1.333))
        >>> rig = StereoRig(camera, camera, np.eye(3), (-0.23, 0, 0), water)
        >>> left, right = rig.project([[0.1, 0.0, 1.2], [0.0, 0.1, 1.3]])
        >>> found = triangulate(rig, left, right, 0.01 * np.eye(2), 0.01 * np.eye(2))
        >>> print(found.points.round(3))
        [[0.1 0.  1.2]
         [0.  0.1 1.3]]
        >>> print(1e3 * np.sqrt(np.diag(found.covariances[0])).round(4))  # mm
        [0.1 0.1 1.1]
        >>> print(triangulate(rig, left[0], right[0], method='straight').points.round(2))
        [0.1 0.  1.1]

    """
    left, right = _pixels(left_px, 'left_px'), _pixels(right_px, 'right_px')
    if left.shape != right.shape:
        msg = f'left_px and right_px must be of one shape, not {left.shape} and {right.shape}'
        raise TriangulationError(msg)
    single = left.ndim == 1
    left, right = left.reshape(-1, 2), right.reshape(-1, 2)
    covs = (
        _covariances(left_cov, len(left), 'left_cov'),
        _covariances(right_cov, len(left), 'right_cov'),
    )
    if method not in METHODS:
        msg = f'method {method!r} is unknown; choose one of {", ".join(METHODS)}'
        raise TriangulationError(msg)
    if parameter_covariance is not None and method != 'refractive':
        msg = f"parameter_covariance belongs to method 'refractive', not to {method!r}"
        raise TriangulationError(msg)
    found = METHODS[method](rig, left, right, *covs)
    if parameter_covariance is not None:
        parameters = np.asarray(parameter_covariance, dtype=float)
        check_parameters(rig, parameters)
        good = found.reasons == ''
        found.covariances[good] += shared_covariances(
            rig,
            found.points[good],
            found.covariances[good],
            (covs[0][good], covs[1][good]),
            parameters,
        )
    if single:
        return Triangulation(
            found.points[0], found.covariances[0], found.residuals[0], found.reasons[0]
        )
    return found


def _straight(
    rig: StereoRig,
    left: FloatArray,
    right: FloatArray,
    left_cov: FloatArray,
    right_cov: FloatArray,
) -> Triangulation:
    points, covariances, reasons = triangulate_straight(rig, left, right, left_cov, right_cov)
    in_air = StereoRig(rig.left, rig.right, rig.rotation, rig.translation)
    return Triangulation(points, covariances, _residuals(in_air, points, left, right), reasons)


def _paper(
    rig: StereoRig,
    left: FloatArray,
    right: FloatArray,
    left_cov: FloatArray,
    right_cov: FloatArray,
) -> Triangulation:
    """Carry the pixels' covariances over by differentiating the method numerically."""
    points, given = triangulate_paper(rig, left, right)
    by_pixel = np.empty((len(left), 3, 4))
    for i in range(4):
        nudge = np.zeros(4)
        nudge[i] = NUDGE
        ahead, _ = triangulate_paper(rig, left + nudge[:2], right + nudge[2:])
        behind, _ = triangulate_paper(rig, left - nudge[:2], right - nudge[2:])
        by_pixel[:, :, i] = (ahead - behind) / (2.0 * NUDGE)
    covariances = _sandwich(by_pixel[:, :, :2], left_cov) + _sandwich(
        by_pixel[:, :, 2:], right_cov
    )
    reasons = np.array(given.tolist(), dtype=object)
    at_the_edge = (reasons == '') & np.isnan(covariances).any(axis=(1, 2))
    reasons[at_the_edge] = AT_THE_EDGE
    points[at_the_edge] = np.nan
    return Triangulation(points, covariances, _residuals(rig, points, left, right), reasons)


def _on_usable(method: Method) -> Method:
    """Run a method on the pairs whose pixels and covariances are sound; refuse the others."""

    def run(
        rig: StereoRig,
        left: FloatArray,
        right: FloatArray,
        left_cov: FloatArray,
        right_cov: FloatArray,
    ) -> Triangulation:
        found = no_points(len(left))
        pixels = np.hstack([left, right, left_cov.reshape(-1, 4), right_cov.reshape(-1, 4)])
        for side, cov in (('left', left_cov), ('right', right_cov)):
            with np.errstate(all='ignore'):
                sound = np.isfinite(whitening(covariance_terms(cov), side, ARRAYS)).all(axis=0)
            found.reasons[~sound] = not_positive_definite(side)
        found.reasons[~np.isfinite(pixels).all(axis=1)] = NOT_FINITE
        good = found.reasons == ''
        some = method(rig, left[good], right[good], left_cov[good], right_cov[good])
        found.points[good], found.covariances[good] = some.points, some.covariances
        found.residuals[good], found.reasons[good] = some.residuals, some.reasons
        return found

    return run


METHODS: dict[str, Method] = {
    'refractive': triangulate_refractive,
    'paper': _on_usable(_paper),
    'straight': _on_usable(_straight),
}


def shared_covariances(
    rig: StereoRig,
    points: FloatArray,
    covariances: FloatArray,
    covs: tuple[FloatArray, FloatArray],
    parameters: FloatArray,
) -> FloatArray:
    """Return what the rig's uncertain parameters do to points: (N, 3, 3), m^2.

    It is the same in every frame, so it does not average out. At the likeliest point X the normal
    equations hold, so dX/dp = -A^-1 sum J^T W J_p, with A^-1 the point's covariance at known
    parameters, and the result is dX/dp C (dX/dp)^T.

    Args:
        rig: cameras and surfaces.
        points: (N, 3) in the rig frame, m.
        covariances: (N, 3, 3) of the points by pixel noise alone, m^2.
        covs: (N, 2, 2) of the left and of the right pixels, px^2.
        parameters: (K, K) covariance of the parameters, in the order of `rig.parameter_names`.
    """
    jacobians = rig.differentiate(points)
    by_parameters = rig.parameter_jacobian(points)
    by_point = (jacobians.left_by_point, jacobians.right_by_point)
    pull = sum(
        np.swapaxes(j, 1, 2) @ np.linalg.solve(cov, k)
        for j, k, cov in zip(by_point, by_parameters, covs, strict=True)
    )
    return _sandwich(covariances @ pull, parameters)


def check_parameters(rig: StereoRig, parameters: FloatArray) -> None:
    """See whether (K, K) is a covariance of the rig's parameters.

    Raises:
        TriangulationError: it is not.
    """
    names = rig.parameter_names
    if parameters.shape != (len(names), len(names)):
        msg = (
            f'parameter_covariance must be {len(names)}x{len(names)}, in the order of'
            f' rig.parameter_names: {", ".join(names)}'
        )
        raise TriangulationError(msg)
    slack = 1e-9 * np.abs(parameters).max(initial=0.0)
    if (
        not np.isfinite(parameters).all()
        or np.abs(parameters - parameters.T).max(initial=0.0) > slack
        or np.linalg.eigvalsh(parameters).min(initial=0.0) < -slack
    ):
        msg = 'parameter_covariance is no covariance: it must be symmetric and not negative'
        raise TriangulationError(msg)


def _sandwich(by: FloatArray, covariance: FloatArray) -> FloatArray:
    return by @ covariance @ np.swapaxes(by, 1, 2)


def _residuals(
    rig: StereoRig, points: FloatArray, left: FloatArray, right: FloatArray
) -> FloatArray:
    return np.hstack([left, right]) - np.hstack(rig.project(points))


def _pixels(values: ArrayLike, what: str) -> FloatArray:
    pixels = np.asarray(values, dtype=float)
    if pixels.ndim not in (1, 2) or pixels.shape[-1] != 2:
        msg = f'{what} must have the shape (N, 2) or (2,), not {pixels.shape}'
        raise TriangulationError(msg)
    return pixels


def _covariances(values: ArrayLike | None, count: int, what: str) -> FloatArray:
    given = np.eye(2) if values is None else np.asarray(values, dtype=float)
    if given.shape not in ((2, 2), (count, 2, 2)):
        msg = f'{what} must have the shape (2, 2) or ({count}, 2, 2), not {given.shape}'
        raise TriangulationError(msg)
    return np.broadcast_to(given, (count, 2, 2))
