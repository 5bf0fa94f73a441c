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
    """Variances (6,) that differ from sample to sample, m^2 and rad^2, of so many samples."""

    variances: Array
    weight: float


class SampleNoise:
    """Measures, axis by axis, how samples of a pose differ from a smooth motion."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what was measured."""
        self._squares = np.zeros(6)
        self._weight = 0.0

    def add(self, stamps: Sequence[int], transforms: Sequence[Transform]) -> Measure | None:
        """Take the newest samples in, stamps in ns; what is measured, None before it can be.

        Of samples that do not lie at equal times the divided difference is taken, scaled so that
        independent noise keeps its variance.
        """
        if len(stamps) <= ORDER:
            return None
        seconds = [(stamp - stamps[0]) * 1e-9 for stamp in stamps]
        weights = []
        for each, own in enumerate(seconds):
            weight = 1.0
            for other, there in enumerate(seconds):
                if other != each:
                    weight /= own - there
            weights.append(weight)
        scale = 1 / sum(weight * weight for weight in weights) ** 0.5
        back = conjugate(transforms[0].rotation)
        sums = [0.0] * 6
        for weight, transform in zip(weights, transforms, strict=True):
            turn = rotation_vector(product(transform.rotation, back))
            for axis, value in enumerate((*transform.translation, *turn)):
                sums[axis] += weight * scale * value
        keep = 1 - 1 / MEMORY
        self._squares = keep * self._squares + np.square(sums)
        self._weight = keep * self._weight + 1.0
        return Measure(self._squares / self._weight, self._weight)


def shares_of(measure: Measure | None, stated: Array) -> Array:
    """(6,) share of stated variances (6,) that differs from sample to sample, 0 to 1.

    All of it, unless clearly less is measured.
    """
    if measure is None:
        return np.ones(6)
    # Of an exponential memory twice its weight counts, in the end.
    chance = SIGNIFICANT * (CORRELATED / measure.weight) ** 0.5
    ratio = measure.variances / stated
    shares: Array = np.where(ratio < 1 - chance, ratio, 1.0)
    return shares


def parted(covariance: Array, shares: Array) -> tuple[Array, Array | None]:
    """The parts (6, 6) of a covariance that differ from sample to sample, and that are slow.

    Each axis keeps its variance; what is slow in one axis is not correlated with what is quick in
    another.
    """
    if (shares == 1.0).all():
        return covariance, None
    quick, slow = np.sqrt(shares), np.sqrt(1 - shares)
    return quick[:, None] * covariance * quick, slow[:, None] * covariance * slow
