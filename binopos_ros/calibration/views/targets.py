"""The target in a pair of pictures, as calibration takes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from binopos_ros.detection import Target


@dataclass(frozen=True)
class Blob:
    """The target in one picture: centre (2,) px, covariance (2, 2) px^2, apparent diameter px."""

    centre: np.ndarray
    covariance: np.ndarray
    diameter: float

    @classmethod
    def of(cls, target: Target) -> Blob:
        """What the detector found."""
        return cls(
            np.asarray(target.centre), np.asarray(target.covariance), float(target.diameter)
        )


@dataclass(frozen=True)
class TargetPair:
    """The target in both pictures of an instant; stamp in nanoseconds."""

    stamp: int
    left: Blob
    right: Blob
