"""The waves' share of a measured position: a damped oscillator per axis, zero in the mean.

The shaping filter of ship positioning (Saelid, Jenssen & Balchen, "Design and analysis of a
dynamic positioning system based on Kalman filtering and optimal control", IEEE TAC 28(3), 1983):
h(s) = k s / (s^2 + 2 zeta omega s + omega^2). The zero at s = 0 says that waves shift the apparent
target to and fro but leave its mean in place. In the states a = omega * integral of u, and u, the
wave's displacement, the stationary covariance is sigma^2 I, so the noise over a step is exactly
sigma^2 (I - Phi Phi^T) whatever the step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def oscillator(omega: Array | float, damping: float, elapsed: Array | float) -> Array:
    """Return the (..., 2, 2) transitions of (a, u) over `elapsed` (s) at `omega` (rad/s).

    Times and frequencies broadcast against each other.
    """
    damped = math.sqrt(1.0 - damping * damping)
    turned = np.asarray(elapsed * omega)
    angle = damped * turned
    decay = np.exp(-damping * turned)
    cosine = decay * np.cos(angle)
    sine = decay * np.sin(angle) / damped
    result = np.empty((*turned.shape, 2, 2))
    result[..., 0, 0] = cosine + damping * sine
    result[..., 0, 1] = sine
    result[..., 1, 0] = -sine
    result[..., 1, 1] = cosine - damping * sine
    return result
