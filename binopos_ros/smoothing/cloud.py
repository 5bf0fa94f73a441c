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
    count = samples.shape[0]
    expectation = samples.sum(axis=0) / count
    deviation = samples - expectation
    entropy = _MEAN_ABSOLUTE_TO_DEVIATION / count * np.abs(deviation).sum(axis=0)
    variance = (deviation * deviation).sum(axis=0) / max(count - 1, 1)
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
    """The cloud of the last `window` drops, exactly; drops is (n, d) with n <= window."""

    window: int
    drops: Array

    @classmethod
    def empty(cls, window: int, dimensions: int = 3) -> SlidingCloud:
        """Return a window without drops."""
        return cls(window, np.empty((0, dimensions)))

    def add(self, drop: Array) -> SlidingCloud:
        """Return the window with one more drop (d,), without the one that falls out of it."""
        kept = self.drops[1:] if len(self.drops) >= self.window else self.drops
        return SlidingCloud(self.window, np.concatenate([kept, drop[None]]))

    def cloud(self) -> Cloud:
        """Return the cloud of the drops in the window."""
        return backward(self.drops)


class RecursiveCloud(NamedTuple):
    """The cloud with exponential forgetting over about `window` drops, in constant time.

    The first `window` drops have equal weights, so it starts as the cloud of all drops so far.
    Deviations are taken from the expectation before the drop: the sliding form's to first order.
    """

    window: float
    total: int
    expectation: Array
    absolute: Array
    variance: Array

    @classmethod
    def empty(cls, window: float, dimensions: int = 3) -> RecursiveCloud:
        """Return a cloud without drops."""
        zero = np.zeros(dimensions)
        return cls(window, 0, zero, zero, zero)

    def add(self, drop: Array) -> RecursiveCloud:
        """Return the cloud with one more drop (d,)."""
        count = self.total + 1
        gain = 1.0 / min(count, self.window)
        deviation = drop - self.expectation
        expectation = self.expectation + gain * deviation
        # The drop itself pulls the expectation, so a deviation from the old one is too large by
        # 1 / (1 - gain) in the mean square; the same shrinking serves the absolute deviation.
        shrunk = math.sqrt(1.0 - gain) * deviation
        forgotten = 1.0 - gain
        return RecursiveCloud(
            self.window,
            count,
            expectation,
            forgotten * self.absolute + gain * np.abs(shrunk),
            forgotten * self.variance + gain * shrunk * shrunk,
        )

    def cloud(self) -> Cloud:
        """Return the cloud as it stands."""
        entropy = _MEAN_ABSOLUTE_TO_DEVIATION * self.absolute
        return Cloud(self.expectation, entropy, _hyper_entropy(self.variance, entropy))


def _hyper_entropy(variance: Array, entropy: Array) -> Array:
    return np.sqrt(np.maximum(variance - entropy * entropy, 0.0))
