"""How an estimator's innovations scatter, against how they should: unit variance, independent.

Noise that is larger than stated, or alike in neighbouring pairs (waves), makes an estimate surer
than its data allow. Both show in the innovations, and so does an estimate that has gone wrong.
The statistics forget: some 200 pairs count.
"""

from __future__ import annotations

import math

#: Weight of the newest pair, and how many pairs of stated scatter the statistics start with.
MEMORY = 0.01
START = 50
#: 99.9 % bounds over 200 independent pairs, of the mean square and of the correlation.
LARGEST_SQUARE, LARGEST_CORRELATION = 1.34, 0.22
MOST_CORRELATED = 0.95
#: Relative step of the running median, the median of a standard normal's magnitude, and the
#: median that chance does not explain.
MEDIAN_STEP, NORMAL_MEDIAN, LARGEST_MEDIAN = 0.03, 0.6745, 0.95
#: Deviations of the mean innovation at which the estimate is wrong.
LARGEST_SHIFT = 5.0


class InnovationScatter:
    """Running statistics of normalised innovations."""

    def __init__(self) -> None:
        self._count = START
        self._mean, self._last = 0.0, 0.0
        self._square, self._product = 1.0, 0.0
        self._persistent = 0.0
        self._median = NORMAL_MEDIAN

    def see(self, score: float) -> None:
        """Take any normalised innovation, outlier or not."""
        up = abs(score) > self._median
        self._median *= math.exp(MEDIAN_STEP if up else -MEDIAN_STEP)

    def use(self, score: float, persistent: float) -> None:
        """Take a normalised innovation that was used.

        Args:
            score: the innovation over its standard deviation.
            persistent: the share of its variance that other pairs have in common with it (the
                estimate's own, and that of errors which all pairs share).
        """
        self._count += 1
        weight = max(MEMORY, 1.0 / self._count)
        deviation = score - self._mean
        self._mean += weight * deviation
        self._square += weight * (deviation * deviation - self._square)
        self._product += weight * (deviation * self._last - self._product)
        self._persistent += weight * (persistent - self._persistent)
        self._last = deviation

    @property
    def width(self) -> float:
        """Deviation of the innovations by their median, which outliers hardly move; at least 1."""
        return self._median / NORMAL_MEDIAN if self._median > LARGEST_MEDIAN else 1.0

    @property
    def discount(self) -> float:
        """By how much the data say less than their stated noise makes them; at least 1.

        Innovations of correlation c from pair to pair hold a share (1 - c) / (1 + c) of what
        independent ones do.
        """
        excess = self._square if self._square > LARGEST_SQUARE else 1.0
        return excess * self.repetition(MOST_CORRELATED)

    def repetition(self, most: float) -> float:
        """How many pairs say as much as one independent pair does; at least 1.

        `most` is the largest correlation that is believed.
        """
        alike = min(self._product / self._square, most)
        return (1.0 + alike) / (1.0 - alike) if alike > LARGEST_CORRELATION else 1.0

    @property
    def lost(self) -> bool:
        """Whether the estimate itself is wrong: the innovations are off centre."""
        expected = self._persistent + self.discount * MEMORY
        return self._mean**2 > LARGEST_SHIFT**2 * expected
