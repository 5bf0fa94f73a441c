"""The normal cloud model (paper Eq. 21-24): a concept by expectation, entropy, hyper-entropy.

A drop x of the cloud is drawn from N(Ex, En'), whose spread En' is itself drawn from N(En, He).
So Ex says where the drops lie, En how widely, and He how uncertain that width is.

Sources: Li, Meng & Shi, "Membership clouds and membership cloud generators", 1995; the backward
generator without certainties: Liu, Feng & Zhang, "An effective algorithm of backward cloud", 2004.
Errata of the paper: its Eq. 22 is a variance used as a standard deviation, and its Eq. 23 sets He
to a constant; both are estimated here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.scalars import Number, smaller

Array = NDArray[np.float64]

_MEAN_ABSOLUTE_TO_DEVIATION = math.sqrt(math.pi / 2.0)
#: Entropies below this (m) are taken for this: a cloud of equal drops has no width to divide by.
SMALLEST_ENTROPY = 1e-9


class Cloud(NamedTuple):
    """A cloud in d dimensions, in the unit of its drops.

    Attributes
    ----------
    expectation : (d,) array
        Ex: the centre.
    entropy : (d,) array
        En: the spread, a standard deviation.
    hyper_entropy : (d,) array
        He: the standard deviation of the spread.

    """

    expectation: Array
    entropy: Array
    hyper_entropy: Array


def backward(drops: ArrayLike) -> Cloud:
    """Estimate the cloud of `drops` (n, d), n >= 1: the backward generator without certainties.

    Ex = mean, En = sqrt(pi/2) mean |x - Ex|, He = sqrt(S^2 - En^2) with S^2 the sample variance;
    He is 0 where S^2 < En^2, which drops with tails lighter than the normal ones give.
    Raises SmoothingError where `drops` is not (n, d) with n >= 1.
    """
    samples = np.asarray(drops, dtype=np.float64)
    if samples.ndim != 2 or samples.shape[0] < 1:
        msg = f'drops of a cloud must have shape (n, d) with n >= 1, not {samples.shape}'
        raise SmoothingError(msg)
    return _backward(samples, np.ones((len(samples), 1)))


def _backward(samples: Array, taken: Array) -> Cloud:
    """Return the cloud of those samples (..., n, d) whose `taken` (..., n, 1) is 1, not 0."""
    count = taken.sum(axis=-2)
    expectation = (taken * samples).sum(axis=-2) / count
    deviation = taken * (samples - expectation[..., None, :])
    entropy = _MEAN_ABSOLUTE_TO_DEVIATION * np.abs(deviation).sum(axis=-2) / count
    variance = (deviation * deviation).sum(axis=-2) / np.maximum(count - 1.0, 1.0)
    return Cloud(expectation, entropy, _hyper_entropy(variance, entropy))


def forward(cloud: Cloud, count: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw `count` drops of `cloud`: returns drops (count, d) and their certainties (count,).

    In d dimensions the mean certainty is 2^(-d/2) whatever En and He are, since a drop lies at
    Ex + En' g with g standard normal, and the mean of exp(-g^2 / 2) is 2^(-1/2).
    """
    size = (count, cloud.expectation.size)
    widths = random.normal(cloud.entropy, cloud.hyper_entropy, size)
    drops = cloud.expectation + widths * random.standard_normal(size)
    return drops, certainty(drops, cloud.expectation, widths)


def certainty(positions: Array, expectation: Array, widths: Array) -> Array:
    """Return the certainties (...,) of `positions` (..., d), Eq. 24; 1 at the expectation.

    `widths` (d,) or (..., d) are En': drawn by the forward generator, or the cloud's entropy.
    """
    ratio = (positions - expectation) / np.maximum(np.abs(widths), SMALLEST_ENTROPY)
    return np.exp(-0.5 * (ratio * ratio).sum(axis=-1))


class SlidingCloud(NamedTuple):
    """The cloud of the last drops, exactly: a full window (..., n, d), the newest drop last.

    `taken` (..., n, 1) is 1 where the window holds a drop, 0 where it is still to be filled.
    """

    drops: Array
    taken: Array

    @classmethod
    def of(cls, drop: Array, window: int) -> SlidingCloud:
        """Return a window of that length that holds one drop (..., d)."""
        drops = np.repeat(drop[..., None, :], window, axis=-2)
        taken = np.zeros((*drops.shape[:-1], 1))
        taken[..., -1, :] = 1.0
        return cls(drops, taken)

    def add(self, drop: Array) -> SlidingCloud:
        """Return the window with one more drop, without the one that falls out of it."""
        newest = np.ones_like(self.taken[..., :1, :])
        return SlidingCloud(
            np.concatenate([self.drops[..., 1:, :], drop[..., None, :]], axis=-2),
            np.concatenate([self.taken[..., 1:, :], newest], axis=-2),
        )

    def cloud(self) -> Cloud:
        """Return the cloud of the drops in the window."""
        return _backward(self.drops, self.taken)


class RecursiveCloud(NamedTuple):
    """The cloud with exponential forgetting over about `window` drops, in constant time.

    Kept are the weighted means of the drops, of their absolute and of their squared deviations,
    each taken from the expectation of the drops before, and shrunk to what they would
    be from the expectation after: the variance of the first `window` drops is exact, the entropy
    is the sliding form's to first order. All but `window` are numbers of one dimension, or arrays.
    """

    window: float
    total: Number
    expectation: Number
    absolute: Number
    variance: Number

    @classmethod
    def of(cls, drop: Number, window: float) -> RecursiveCloud:
        """Return the cloud of one drop."""
        return cls(window, 1.0, drop, 0.0 * drop, 0.0 * drop)

    @classmethod
    def at_rest(cls, entropy: Number, total: float, window: float) -> RecursiveCloud:
        """Return a cloud about 0 as if `total` drops of that `entropy` had been seen."""
        absolute = entropy / _MEAN_ABSOLUTE_TO_DEVIATION
        return cls(window, total, 0.0 * entropy, absolute, entropy * entropy)

    def add(self, drop: Number, weight: Number = 1.0) -> RecursiveCloud:
        """Return the cloud with one more drop of a weight from 0 to 1."""
        window, total, expectation, absolute, variance = self
        total = total + weight
        gain = weight / smaller(total, window)
        kept = 1.0 - gain
        deviation = drop - expectation
        # The drop pulls the expectation, so that deviations from the old one are too large by
        # the factor 1 / (1 - gain) in the mean square.
        shrunk = kept * deviation * deviation
        return RecursiveCloud(
            window,
            total,
            expectation + gain * deviation,
            kept * absolute + gain * shrunk**0.5,
            kept * variance + gain * shrunk,
        )

    @property
    def entropy(self) -> Number:
        """En as it stands."""
        return _MEAN_ABSOLUTE_TO_DEVIATION * self.absolute

    def cloud(self) -> Cloud:
        """Return the cloud as it stands."""
        entropy = np.asarray(self.entropy)
        variance = np.asarray(self.variance)
        return Cloud(np.asarray(self.expectation), entropy, _hyper_entropy(variance, entropy))


def _hyper_entropy(variance: Array, entropy: Array) -> Array:
    return np.sqrt(np.maximum(variance - entropy * entropy, 0.0))
