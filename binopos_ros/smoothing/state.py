"""What every filter says after a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Variance of a position (m^2) and a velocity (m^2/s^2) of which nothing is known.
UNKNOWN_VARIANCE = 1e6


class FilterState(NamedTuple):
    """The filtered target at one instant, in the frame of the measurements.

    Attributes
    ----------
    stamp : float
        Instant that the state holds for (s).
    position : (3,) array
        Position (m).
    velocity : (3,) array
        Velocity (m/s).
    covariance : (6, 6) array
        Covariance of position and velocity, in this order (m^2, m^2/s, m^2/s^2).
    certainty : float
        Weight of the measurement, 0 to 1: 1 is taken in full, 0 was not used.
    reason : str
        '' where the measurement was used, otherwise why it was not.
    known : bool
        False until a first measurement was used; the position then means nothing.

    """

    stamp: float
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    covariance: NDArray[np.float64]
    certainty: float
    reason: str = ''
    known: bool = True


def unknown_state(stamp: float, reason: str) -> FilterState:
    """Return the state of a filter that has not used any measurement yet."""
    zero = np.zeros(3)
    return FilterState(
        stamp, zero, zero.copy(), UNKNOWN_VARIANCE * np.eye(6), 0.0, reason, known=False
    )
