"""Motion of the target between measurements: constant velocity, driven by white acceleration.

Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001,
Sec. 6.2.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_EYE3 = np.eye(3)
_RATE = np.kron([[0.0, 1.0], [0.0, 0.0]], _EYE3)
_EYE6 = np.eye(6)
_POSITION = np.kron([[1.0, 0.0], [0.0, 0.0]], _EYE3)
_CROSS = np.kron([[0.0, 1.0], [1.0, 0.0]], _EYE3)
_VELOCITY = np.kron([[0.0, 0.0], [0.0, 1.0]], _EYE3)


def transition(elapsed: float) -> Array:
    """Return the (6, 6) transition of position and velocity over `elapsed` seconds."""
    return _EYE6 + elapsed * _RATE


def white_acceleration(elapsed: float, density: float) -> Array:
    """Return the (6, 6) process noise of white acceleration of `density` (m^2/s^3)."""
    return density * (
        (elapsed**3 / 3.0) * _POSITION + (elapsed**2 / 2.0) * _CROSS + elapsed * _VELOCITY
    )
