"""A filter over arrays: a recording that lies there as a whole."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.factory import make_filter

Array = NDArray[np.float64]


class Smoothed(NamedTuple):
    """The states after each of N measurements, as arrays.

    Attributes
    ----------
    stamps : (N,) array
        Instants that the states hold for (s).
    positions : (N, 3) array
        Positions (m); nan before a first measurement was used.
    velocities : (N, 3) array
        Velocities (m/s); nan before a first measurement was used.
    covariances : (N, 6, 6) array
        Covariances of position and velocity (m^2, m^2/s, m^2/s^2); nan likewise.
    certainties : (N,) array
        Weights of the measurements, 0 to 1.
    reasons : (N,) array of str
        '' where the measurement was used, otherwise why it was not.

    """

    stamps: Array
    positions: Array
    velocities: Array
    covariances: Array
    certainties: Array
    reasons: NDArray[np.str_]


def smooth(
    stamps: ArrayLike,
    positions: ArrayLike,
    covariances: ArrayLike,
    media: ArrayLike | None = None,
    name: str = 'cloud-kalman',
    **options: Any,
) -> Smoothed:
    """Run a filter over N measurements, as :meth:`Filter.step` does one by one.

    Each state knows of the measurements up to its own alone: it is what a live node would have
    said.

    Parameters
    ----------
    stamps : (N,) array
        Instants of the measurements (s).
    positions : (N, 3) array
        Measured positions (m); a row of nan, as of a frame without the target, gives the
        prediction.
    covariances : (N, 3, 3) array, or (3, 3) for all
        Their covariances (m^2), the medium's part included.
    media : (N, 3, 3) array, optional
        The part of each that a waving surface makes (m^2).
    name : str
        Of the filter; `make_filter` has the names and takes the options.

    Raises
    ------
    SmoothingError
        An unknown filter or option, or arrays whose shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> stamps = np.arange(60) / 30
    >>> truth = np.array([0.1, 0.0, 1.2]) + np.outer(stamps, [0.05, 0.0, 0.0])
    >>> noise = np.random.default_rng(0).normal(0.0, 0.002, truth.shape)
    >>> smoothed = smooth(stamps, truth + noise, 0.002**2 * np.eye(3), name='kalman')
    >>> smoothed.positions.shape, smoothed.covariances.shape
    ((60, 3), (60, 6, 6))
    >>> errors = smoothed.positions - truth
    >>> bool(np.abs(errors[30:]).mean() < 0.6 * np.abs(noise[30:]).mean())
    True

    """
    instants, points = np.asarray(stamps, np.float64), np.asarray(positions, np.float64)
    count = len(instants) if instants.ndim == 1 else -1
    if points.shape != (count, 3):
        msg = f'stamps {instants.shape} and positions {points.shape} must be (N,) and (N, 3)'
        raise SmoothingError(msg)
    spreads = _matrices(covariances, count, 'covariances')
    waving = None if media is None else _matrices(media, count, 'media')
    smoother = make_filter(name, **options)
    states = [
        smoother.step(stamp, points[k], spreads[k], None if waving is None else waving[k])
        for k, stamp in enumerate(instants.tolist())
    ]
    unknown = np.array([not state.known for state in states], dtype=bool)
    whole = Smoothed(
        np.array([state.stamp for state in states]),
        np.reshape([state.position for state in states], (count, 3)),
        np.reshape([state.velocity for state in states], (count, 3)),
        np.reshape([state.covariance for state in states], (count, 6, 6)),
        np.array([state.certainty for state in states]),
        np.array([state.reason for state in states], dtype=np.str_),
    )
    for kept in (whole.positions, whole.velocities, whole.covariances):
        kept[unknown] = np.nan
    return whole


def _matrices(values: ArrayLike, count: int, name: str) -> Array:
    """Return (N, 3, 3) of them, or of one for all."""
    matrices = np.asarray(values, np.float64)
    if matrices.shape not in ((3, 3), (count, 3, 3)):
        msg = f'{name} {matrices.shape} must be ({count}, 3, 3), or (3, 3) for all'
        raise SmoothingError(msg)
    return np.broadcast_to(matrices, (count, 3, 3))
