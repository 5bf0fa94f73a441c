"""Motion of the target between measurements: constant velocity, driven by white acceleration.

Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001,
Sec. 6.2.2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: One time span, or one for each sequence of a batch.
Seconds = float | Array

_EYE3 = np.eye(3)
_RATE = np.kron([[0.0, 1.0], [0.0, 0.0]], _EYE3)
_EYE6 = np.eye(6)
_POSITION = np.kron([[1.0, 0.0], [0.0, 0.0]], _EYE3)
_CROSS = np.kron([[0.0, 1.0], [1.0, 0.0]], _EYE3)
_VELOCITY = np.kron([[0.0, 0.0], [0.0, 1.0]], _EYE3)


def transition(elapsed: Seconds) -> Array:
    """Return the (..., 6, 6) transitions of position and velocity over `elapsed` seconds."""
    return _EYE6 + np.asarray(elapsed)[..., None, None] * _RATE


def white_acceleration(elapsed: Seconds, density: float) -> Array:
    """Return the (..., 6, 6) process noises of white acceleration of `density` (m^2/s^3)."""
    time = np.asarray(elapsed)[..., None, None]
    squared = time * time
    return (density / 3.0 * squared * time) * _POSITION + (
        (0.5 * density * squared) * _CROSS + (density * time) * _VELOCITY
    )
