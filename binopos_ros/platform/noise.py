"""How much poses of a robot err from sample to sample, measured from themselves.

A robot states one covariance for its pose, which holds both what differs from sample to sample
and what drifts with the minutes. A filter averages the first away and must never count on doing so
with the second. The samples themselves tell: differences of the third order leave nothing of a
smooth motion and of a slow drift, and all of what is independent.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.platform.quaternions import conjugate, product, rotation_vector
from binopos_ros.platform.transforms import Transform

Array = NDArray[np.float64]

ORDER = 3
#: Samples over which the measure is taken: two seconds of an odometry at 50 Hz.
MEMORY = 100.0
#: 1 + 2 sum of the squared autocorrelations of third differences (-15/20, 6/20, -1/20) of white
#: noise: so much longer does it take than with independent ones.
CORRELATED = 2.31
#: Standard deviations from which on less than stated is no chance.
SIGNIFICANT = 3.0


class Measure(NamedTuple):
    """Six variances that differ from sample to sample, m^2 and rad^2, of so many samples."""

    variances: tuple[float, ...]
    weight: float


class SampleNoise:
    """Measures, axis by axis, how samples of a pose differ from a smooth motion."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what was measured."""
        self._squares = [0.0] * 6
        self._weight = 0.0

    def add(self, stamps: Sequence[int], transforms: Sequence[Transform]) -> Measure | None:
        """Take the newest samples in, stamps in ns; what is measured, None before it can be.

        Of samples that do not lie at equal times the divided difference is taken, scaled so that
        independent noise keeps its variance.
        """
        if len(stamps) <= ORDER:
            return None
        # Plain floats: this is done for every sample.
        t1, t2, t3 = ((stamp - stamps[0]) * 1e-9 for stamp in stamps[1:])
        w0 = -1 / (t1 * t2 * t3)
        w1 = 1 / (t1 * (t1 - t2) * (t1 - t3))
        w2 = 1 / (t2 * (t2 - t1) * (t2 - t3))
        w3 = 1 / (t3 * (t3 - t1) * (t3 - t2))
        share = 1 / (w0 * w0 + w1 * w1 + w2 * w2 + w3 * w3)
        first, *others = transforms
        back = conjugate(first.rotation)
        turns = [rotation_vector(product(other.rotation, back)) for other in others]
        keep = 1 - 1 / MEMORY
        self._weight = keep * self._weight + 1.0
        squares = self._squares
        for axis in range(3):
            a, b, c = (other.translation[axis] for other in others)
            place = w0 * first.translation[axis] + w1 * a + w2 * b + w3 * c
            squares[axis] = keep * squares[axis] + share * place * place
            turn = w1 * turns[0][axis] + w2 * turns[1][axis] + w3 * turns[2][axis]
            squares[axis + 3] = keep * squares[axis + 3] + share * turn * turn
        return Measure(tuple(square / self._weight for square in squares), self._weight)


def parted(covariance: Array, measure: Measure | None) -> tuple[Array, Array | None]:
    """The parts (6, 6) of a stated covariance that differ from sample to sample, and are slow.

    All of it differs, unless clearly less is measured, axis by axis. Each axis keeps its variance;
    what is slow in one is not correlated with what is quick in another.
    """
    if measure is None:
        return covariance, None
    # Of an exponential memory twice its weight counts, in the end.
    clear = 1 - SIGNIFICANT * (CORRELATED / measure.weight) ** 0.5
    ratios = [
        measured / stated
        for measured, stated in zip(measure.variances, covariance.diagonal().tolist(), strict=True)
    ]
    if min(ratios) >= clear:
        return covariance, None
    shares = np.array([ratio if ratio < clear else 1.0 for ratio in ratios])
    quick, slow = np.sqrt(shares), np.sqrt(1 - shares)
    return quick[:, None] * covariance * quick, slow[:, None] * covariance * slow
