"""A scalar Kalman filter on the refractive index, and the trial of two of them against each other.

Forgetting: between pairs the index is an Ornstein-Uhlenbeck process about the prior: a random walk
of `drift` per square root of a second that the prior holds in bounds. Without data the estimate
returns to the prior, within about 2 (prior_std / drift)^2 seconds.

Errors that all pairs share (where the interface lies, where a known plane lies) do not average
out. They are *considered* (Schmidt's filter): never estimated, but their correlation with the
estimate is kept, so that no number of pairs makes it surer than they allow.

Waves disturb neighbouring pairs alike, and pixels may be noisier than they claim: what the data
say is discounted by how their innovations scatter (see `scatter.py`).

A fault (images of different instants, another calibration, a camera knocked over) leaves a filter
that has followed it, or one that takes all that comes for noise. So a second filter always starts
anew from the prior beside the first, and takes its place as soon as it predicts the pairs so much
better that chance does not explain it (a cumulative sum of the logarithms of their likelihoods).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.evidence import Clue, Evidence
from binopos_ros.triangulation.scatter import InnovationScatter

Array = NDArray[np.float64]

#: A pair that alone tells the index no better than this cannot tell water from air.
PAIR_STD_LIMIT = 1.0
NOT_OBSERVABLE = 'index not observable from this pair'
OUTLIER = 'outlier: both rays disagree at any likely index'
OFF_PLANE = 'outlier: target not in the known plane'

#: Logarithm of the likelihood that an outlier has at the least.
OUTLIER_LIKELIHOOD = -8.0
#: The newcomer takes over when it is ahead by so much (odds of 22,000), times the number of pairs
#: that are alike: calm between two waves proves nothing. (A fault makes pairs alike as well, so
#: that much of it is believed.) It starts anew when it is as far behind, when the pairs surprise
#: it by so much, and after so many pairs in any case.
LEAD = 10.0
MOST_CORRELATED = 0.6
LONGEST_TRIAL = 300
#: Half a squared score surprises from here on; it is 0.5 in the mean.
SURPRISE = 2.0


class Belief(NamedTuple):
    """The index: mean, variance, and covariance (k,) with the considered parameters."""

    mean: float
    variance: float
    shared: Array


class Verdict(NamedTuple):
    """What became of a clue.

    Attributes:
        belief: after it.
        reason: '' or why it was not used.
        score: its normalised innovation; None where there was no clue.
        persistent: share of the innovation's variance that does not change from pair to pair.
        likelihood: the logarithm of it.
    """

    belief: Belief
    reason: str
    score: float | None = None
    persistent: float = 0.0
    likelihood: float = 0.0


class FollowingOptions(NamedTuple):
    """What a filter starts with, as `IndexEstimator` explains it.

    `considered` is the covariance (k, k) of the considered parameters.
    """

    prior_mean: float
    prior_variance: float
    drift: float
    considered: Array
    plane: KnownPlane | None
    gate: float
    huber: float


class IndexFilter:
    """Follows the index from clue to clue."""

    def __init__(self, options: FollowingOptions) -> None:
        self._options = options
        self._rate = options.drift**2 / (2.0 * options.prior_variance)
        self._restart()

    def _restart(self) -> None:
        options = self._options
        shared = np.zeros(len(options.considered))
        self._belief = Belief(options.prior_mean, options.prior_variance, shared)
        self._scatter = InnovationScatter()

    def predict(self, elapsed: float) -> None:
        """Let so many seconds pass: the index drifts back to the prior, and is less certain."""
        belief, options = self._belief, self._options
        keep = math.exp(-self._rate * elapsed)
        self._belief = Belief(
            options.prior_mean + keep * (belief.mean - options.prior_mean),
            options.prior_variance - keep**2 * (options.prior_variance - belief.variance),
            keep * belief.shared,
        )

    def weigh(self, evidence: Evidence) -> Verdict:
        """Return what the two rays and the known plane make of the index; changes nothing."""
        plane = self._options.plane
        if evidence.clue.gain * PAIR_STD_LIMIT >= 1.0:
            verdict = self._follow(self._belief, evidence.at, evidence.clue, OUTLIER)
        else:
            verdict = Verdict(self._belief, NOT_OBSERVABLE)
        if plane is None or verdict.reason == OUTLIER:
            return verdict
        held = self._follow(verdict.belief, evidence.at, plane.clue(evidence), OFF_PLANE)
        if verdict.score is None or held.reason:
            return held
        return verdict._replace(belief=held.belief)

    def take(self, verdict: Verdict) -> None:
        """Believe a verdict, and start again where the scatter says that the estimate is wrong."""
        self._belief = verdict.belief
        if verdict.score is None:
            return
        self._scatter.see(verdict.score)
        if not verdict.reason:
            self._scatter.use(verdict.score, verdict.persistent)
        if self._scatter.lost:
            self._restart()

    @property
    def repetition(self) -> float:
        """How many pairs say as much as one independent pair does."""
        return self._scatter.repetition(MOST_CORRELATED)

    def told(self, belief: Belief | None = None) -> Belief:
        """Return a belief, its own by default, with the data discounted by their scatter."""
        belief, discount = belief or self._belief, self._scatter.discount
        prior_variance, prior_mean = self._options.prior_variance, self._options.prior_mean
        known = 1.0 / belief.variance - 1.0 / prior_variance
        if discount == 1.0 or known <= 0.0:
            return belief
        variance = 1.0 / (1.0 / prior_variance + known / discount)
        # The data's weight in the mean, as it was and as it is now.
        share = (1.0 - variance / prior_variance) / (known * belief.variance)
        return Belief(
            prior_mean + share * (belief.mean - prior_mean), variance, share * belief.shared
        )

    def _follow(self, prior: Belief, at: float, clue: Clue, outlier: str) -> Verdict:
        """Schmidt's update of the belief by one clue, gated and with Huber's weight."""
        options = self._options
        shared = np.zeros(len(options.considered))
        shared[: len(clue.shared)] = clue.shared
        innovation = clue.innovation - clue.gain * (prior.mean - at)
        cross = float(shared @ prior.shared)
        carried = options.considered @ shared
        spread = clue.gain * (clue.gain * prior.variance + 2.0 * cross) + float(shared @ carried)
        score = innovation / math.sqrt(spread + 1.0)
        width = self._scatter.width
        usual = abs(score) / width
        persistent = spread / (spread + 1.0)
        likelihood = -0.5 * (usual * usual + math.log(spread + 1.0)) - math.log(width)
        likelihood = max(likelihood, OUTLIER_LIKELIHOOD)
        if usual > options.gate:
            return Verdict(prior, outlier, score, persistent, likelihood)
        total = spread + max(1.0, usual / options.huber)
        step = (clue.gain * prior.variance + cross) / total
        belief = Belief(
            prior.mean + step * innovation,
            prior.variance - step * step * total,
            prior.shared - step * (clue.gain * prior.shared + carried),
        )
        return Verdict(belief, '', score, persistent, likelihood)


class Trial:
    """The filter in office, and the newcomer beside it that started at the prior."""

    def __init__(self, options: FollowingOptions) -> None:
        self._options = options
        self.holder = IndexFilter(options)
        self._begin()

    def _begin(self) -> None:
        self._newcomer = IndexFilter(self._options)
        self._lead, self._surprise, self._pairs = 0.0, 0.0, 0

    def predict(self, elapsed: float) -> None:
        """Let so many seconds pass for both."""
        self.holder.predict(elapsed)
        self._newcomer.predict(elapsed)

    def take(self, verdict: Verdict, evidence: Evidence) -> bool:
        """Let the holder believe its verdict and the newcomer its own; tell of a change."""
        other = self._newcomer.weigh(evidence)
        self.holder.take(verdict)
        self._newcomer.take(other)
        if verdict.score is None or other.score is None:
            return False
        surprise = min(0.5 * other.score**2, -OUTLIER_LIKELIHOOD) - SURPRISE
        self._surprise = max(0.0, self._surprise + surprise)
        self._lead += other.likelihood - verdict.likelihood
        self._pairs += 1
        if self._lead > LEAD * self.holder.repetition:
            self.holder = self._newcomer
            self._begin()
            return True
        if self._lead < -LEAD or self._surprise > LEAD or self._pairs > LONGEST_TRIAL:
            self._begin()
        return False
