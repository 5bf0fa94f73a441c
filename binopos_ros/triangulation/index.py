"""The refractive index of the target's medium, live, from the disagreement of two bent rays.

A pair of images gives four numbers and a point takes three: one is left over, and it depends on
the index (see `evidence.py`). It corrects a scalar Kalman state, linearised anew at each pair (see
`following.py`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics import StereoRig
from binopos_ros.triangulation.considered import changed_rigs, principal_errors
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.evidence import Evidence, gather_evidence
from binopos_ros.triangulation.following import (
    NOT_OBSERVABLE,
    PAIR_STD_LIMIT,
    FollowingOptions,
    Trial,
)

Array = NDArray[np.float64]

DIFFERENT_POINTS = 'left and right do not see the same point'

#: Shift of the index that makes the linearisation worth repeating; what is left is below 2e-5.
_RELINEARISE = 3e-3
_MAX_LINEARISATIONS = 4
_LARGEST_INDEX = 4.0


@dataclass(frozen=True)
class IndexState:
    """What is known of the index after a pair, and the position that goes with it.

    Attributes:
        mean: refractive index of the target's medium.
        std: its standard deviation.
        observed: True where the data, discounted by their scatter, say at least as much about the
            index as the prior does; False where the estimate rests on the prior.
        frame_index: the index that this pair alone gives (the paper's mean refractive index of
            the frame); nan where it gives none.
        frame_index_std: its standard deviation; nan with it.
        reason: '' where the pair corrected the index, else why it did not.
        point: (3,) the target in the rig frame at `mean`, m; nan where there is none.
        covariance: (3,3) of the point, m^2, with the uncertainty of the index and of all that is
            considered.
        noise: (3,3) the part of it that pixel noise makes, m^2.
        residuals: (4,) px, observed minus predicted, left u, v then right u, v.
    """

    mean: float
    std: float
    observed: bool
    frame_index: float
    frame_index_std: float
    reason: str
    point: Array
    covariance: Array
    noise: Array
    residuals: Array


class IndexEstimator:
    """Follows the refractive index of the target's medium from pair to pair.

    Args:
        prior_mean: index before the first pair (see `seawater.index_prior`).
        prior_std: its standard deviation.
        drift: standard deviation of the index's change within a second; it grows with the square
            root of time. 0: the index is constant. 1e-4 lets it move by 0.006 in an hour.
        known_plane: a plane that the target is known to lie in.
        parameter_covariance: (K,K) of the errors of the rig's surfaces, in the order and units of
            `StereoRig.parameter_names`; its row and column of target_index are not used.
        calibration_std: systematic error of the calibrated pixels, px: what is left of the
            epipolar errors when the noise is averaged out.
        epipolar_gate: pairs that leave a larger residual than this, px, at the index known before
            did not see one target: they tell nothing. 0: there is no such gate.
        gate: innovations beyond this many standard deviations are outliers and not used.
        huber: innovations beyond this many standard deviations weigh less (Huber's weight).
            For both, the deviation is the stated one, or what the innovations show if larger.

    Raises:
        TriangulationError: a prior, drift or bound that cannot be.
    """

    def __init__(
        self,
        prior_mean: float,
        prior_std: float,
        *,
        drift: float = 0.0,
        known_plane: KnownPlane | None = None,
        parameter_covariance: ArrayLike | None = None,
        calibration_std: float = 0.0,
        epipolar_gate: float = 0.0,
        gate: float = 4.0,
        huber: float = 2.0,
    ) -> None:
        if _possible(prior_mean) != prior_mean:
            msg = f'index prior: {prior_mean} is no refractive index of a clear medium (1 to 4)'
            raise TriangulationError(msg)
        for name, value in (('prior std', prior_std), ('gate', gate), ('huber', huber)):
            if not (math.isfinite(value) and value > 0):
                msg = f'index estimate: {name} is {value}: it must be above 0'
                raise TriangulationError(msg)
        for name, value in (
            ('drift', drift),
            ('calibration std', calibration_std),
            ('epipolar gate', epipolar_gate),
        ):
            if not (math.isfinite(value) and value >= 0):
                msg = f'index estimate: {name} is {value}: it must be 0 or more'
                raise TriangulationError(msg)
        self._plane = known_plane
        self._errors = _errors_beside_index(parameter_covariance)
        self._calibration_std = calibration_std
        self._epipolar_gate = epipolar_gate
        # All are counted in their own deviations, but the plane's offset in metres.
        count = len(self._errors) + (4 if calibration_std > 0 else 0)
        plane = [] if known_plane is None else [known_plane.std**2]
        self._considered = np.diag([1.0] * count + plane)
        self._options = FollowingOptions(
            float(prior_mean),
            float(prior_std) ** 2,
            drift,
            self._considered,
            known_plane,
            gate,
            huber,
        )
        self._given: StereoRig | None = None
        self._changed: list[StereoRig] = []
        self._assumed: tuple[StereoRig, list[StereoRig]] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all pairs: back to the prior."""
        self._stamp: float | None = None
        self._trial = Trial(self._options)

    def update(
        self,
        rig: StereoRig,
        left_px: ArrayLike,
        right_px: ArrayLike,
        left_cov: ArrayLike | None = None,
        right_cov: ArrayLike | None = None,
        stamp: float = 0.0,
    ) -> IndexState:
        """Triangulate one pair at the index known so far, and correct the index by it.

        Args:
            rig: cameras and interface; the index of the target's medium in it is not used.
            left_px: (2,) pixels in the left image.
            right_px: (2,) pixels in the right image.
            left_cov: (2,2) covariance of `left_px`, px^2.
            right_cov: (2,2) covariance of `right_px`, px^2.
            stamp: of the pair, s; one that jumps back counts as no time passed.

        Raises:
            TriangulationError, OpticsError: as `triangulate` raises them.
        """

        def gather(index: float, known: Evidence | None = None) -> Evidence:
            assumed, changes = self._rigs_near(rig, index)
            near = None
            if known is not None:
                x, y, z = (known.point + (index - known.at) * known.by_index).tolist()
                near = x, y, z
            return gather_evidence(
                assumed,
                left_px,
                right_px,
                left_cov,
                right_cov,
                changes,
                self._calibration_std,
                near,
            )

        elapsed = 0.0 if self._stamp is None else max(stamp - self._stamp, 0.0)
        self._stamp = stamp
        self._trial.predict(elapsed)
        holder = self._trial.holder
        evidence = gather(_possible(holder.told().mean))
        if evidence.reason:
            return self._state(evidence, evidence.reason)
        if 0.0 < self._epipolar_gate < np.abs(evidence.residuals).max():
            return self._state(evidence, DIFFERENT_POINTS)
        verdict = holder.weigh(evidence)
        for _ in range(_MAX_LINEARISATIONS - 1):
            index = _possible(holder.told(verdict.belief).mean)
            if abs(index - evidence.at) <= _RELINEARISE:
                break
            nearer = gather(index, evidence)
            if nearer.reason:
                break
            evidence, verdict = nearer, holder.weigh(nearer)
        if self._trial.take(verdict, evidence):
            nearer = gather(_possible(self._trial.holder.told().mean), evidence)
            evidence = evidence if nearer.reason else nearer
        return self._state(evidence, verdict.reason)

    def _rigs_near(self, rig: StereoRig, index: float) -> tuple[StereoRig, list[StereoRig]]:
        """Return the rig with about this index, and its copies with one error each.

        They serve until the index has moved.
        """
        if self._given is not rig:
            if len(self._errors) and self._errors.shape[1] != len(rig.parameter_names):
                msg = (
                    f'parameter covariance is for {self._errors.shape[1]} parameters, and the rig '
                    f'has {len(rig.parameter_names)}: {", ".join(rig.parameter_names)}'
                )
                raise TriangulationError(msg)
            self._given, self._assumed = rig, None
            self._changed = changed_rigs(rig, self._errors)
        if self._assumed is not None:
            assumed, changes = self._assumed
            if abs(cast(float, assumed.target_index) - index) <= _RELINEARISE:
                return assumed, changes
        assumed = rig.with_target_index(index)
        changes = [changed.with_target_index(index) for changed in self._changed]
        self._assumed = assumed, changes
        return assumed, changes

    def _state(self, evidence: Evidence, reason: str) -> IndexState:
        belief, clue = self._trial.holder.told(), evidence.clue
        telling = clue.gain * PAIR_STD_LIMIT >= 1.0
        if self._plane is not None and reason in ('', NOT_OBSERVABLE):
            evidence = self._plane.hold(evidence)
        by_index, by_shared = evidence.by_index, evidence.by_shared
        count = by_shared.shape[1]
        correlated = np.outer(by_index, by_shared @ belief.shared[:count])
        mean = _possible(belief.mean)
        return IndexState(
            mean=mean,
            std=math.sqrt(belief.variance),
            observed=belief.variance <= 0.5 * self._options.prior_variance,
            frame_index=evidence.at + clue.innovation / clue.gain if telling else math.nan,
            frame_index_std=1.0 / clue.gain if telling else math.nan,
            reason=reason,
            point=evidence.point + by_index * (mean - evidence.at),
            covariance=(
                evidence.covariance
                + belief.variance * np.outer(by_index, by_index)
                + correlated
                + correlated.T
                + by_shared @ self._considered[:count, :count] @ by_shared.T
            ),
            noise=evidence.covariance,
            residuals=evidence.residuals,
        )


def _possible(index: float) -> float:
    """A wide prior lets noise carry the estimate beyond what a clear medium's index can be."""
    return min(max(index, 1.0), _LARGEST_INDEX)


def _errors_beside_index(covariance: ArrayLike | None) -> Array:
    """Return the rig's errors (E,K) but for that of the index, which is estimated."""
    if covariance is None:
        return np.zeros((0, 0))
    rest = np.array(covariance, dtype=np.float64)
    if rest.ndim == 2:
        rest[0, :] = rest[:, 0] = 0.0
    return principal_errors(rest)
