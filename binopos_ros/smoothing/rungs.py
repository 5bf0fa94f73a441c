"""The rungs of the ladder: how freely a target may move, and how it changes from one to another.

Motion hypotheses are added here. See :mod:`binopos_ros.smoothing.ladder` for what they mean.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.smoothing.chain import eigenbasis

Array = NDArray[np.float64]

#: Variances that a target without a velocity gains per frame, in those of a measurement: one at
#: rest, and such as go to and fro within so few frames that no velocity foretells them.
GAINED = (0.0, 3.0, 30.0)
#: Manoeuvring indices of the rungs: of these, of a steady target, and a decade each.
_DECADES = range(-5, 8)
INDICES = np.array([*(0.0 for _ in GAINED), 0.0, *(10.0**decade for decade in _DECADES)])
RUNGS = INDICES.size
REST, STEADY = 0, len(GAINED)
#: The rungs without a velocity.
STANDING = slice(STEADY)
#: How high each rung is, in decades: one that wanders is as high as its number.
HEIGHTS = np.arange(RUNGS) - STEADY + 1.0
HEIGHTS[STANDING] = 0.0, *(np.log10(GAINED[1:]) - _DECADES[0] + HEIGHTS[STEADY + 1])
#: Frames for which a target stays on a rung in the mean: longer where it is steady, as the lower
#: rungs are told from each other the later.
_DWELLS = np.where(INDICES < 0.1, 100.0, 20.0)
_DWELLS[STANDING], _DWELLS[STEADY] = 20.0, 200.0
#: A rung further is that much rarer.
_FARTHER = 0.5
#: Deviation of the velocity at first on a rung, in those that it gains in a frame.
_FIRST_SPEED = 10.0
#: Of a velocity of which a rung itself says nothing, per frame, in deviations of the measurement.
_LEAST_FIRST_SPEED = 1.0
#: From this rung on the gain of the position is above 0.97: taken for 1, so that nothing lags.
FOLLOWS = int(np.searchsorted(INDICES, 100.0))
#: No rung is ever ruled out for good.
LEAST_WEIGHT = 1e-12

#: White acceleration and velocity of each rung, of all axes, as each has rungs of its own.
DRIVEN = np.tile(INDICES, (3, 1))
WALKED = np.zeros((3, RUNGS))
WALKED[:, STANDING] = GAINED
#: Variances of the velocity at first, and probabilities.
FIRST_SPEEDS = np.maximum(_FIRST_SPEED**2 * DRIVEN, _LEAST_FIRST_SPEED**2)
FIRST_SPEEDS[:, STANDING] = 0.0
# None is taken for one that wanders before it was seen to.
FIRST_WEIGHTS = np.ones((3, RUNGS))
FIRST_WEIGHTS[:, REST + 1 : STEADY] = LEAST_WEIGHT
FIRST_WEIGHTS /= FIRST_WEIGHTS.sum(axis=1, keepdims=True)


class Switching(NamedTuple):
    """Of the rungs' Markov chain: eigenvalues (R,) per frame, and projections (R, R * R)."""

    rates: Array
    projections: Array


def switching(resting_frames: float) -> Switching:
    """Return how a target changes from rung to rung that stays at rest for so many frames."""
    dwells = _DWELLS.copy()
    dwells[REST] = resting_frames
    shares = _FARTHER ** np.abs(np.subtract.outer(HEIGHTS, HEIGHTS))
    np.fill_diagonal(shares, 0.0)
    rates = shares / shares.sum(axis=1, keepdims=True) / dwells[:, None]
    eigenvalues, projections = eigenbasis(rates - np.diag(rates.sum(axis=1)))
    return Switching(eigenvalues, projections.reshape(RUNGS, -1))
