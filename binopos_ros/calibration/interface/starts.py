"""Where the descent to an interface begins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.adjust import NEARLY, Adjustment, Prior, adjust
from binopos_ros.calibration.adjustment.start import straight_poses, sunk
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.guesses import Guess, unknowns
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RigState

#: First guesses of an unknown distance, as parts of the way to the nearest board.
FRACTIONS = (0.5, 0.15, 0.85)
GOOD_START = 0.5  # px; a descent into a wrong valley ends far above it


@dataclass(frozen=True)
class Known:
    """What is known beforehand.

    Attributes:
        air: the rig without interfaces.
        guesses: of the interfaces.
        air_covariance: of the cameras' parameters; None takes them as exact.
    """

    air: RigState
    guesses: Sequence[Guess]
    air_covariance: ParameterCovariance | None = None


def best_start(
    known: Known, views: Sequence[View], free_cameras: bool = False, converged: float = NEARLY
) -> tuple[Adjustment, Prior]:
    """Of several first distances, the one from which the pictures are explained best.

    Args:
        known: beforehand.
        views: what was seen.
        free_cameras: as in `calibrate_interface`.
        converged: as in `adjust`.

    Raises:
        CalibrationError: from none of them anything is seen.
    """
    straight = straight_poses(known.air, views)
    nearest = min(
        float(np.min(pose.apply(view.points)[:, 2]))
        for pose, view in zip(straight, views, strict=True)
    )
    best: tuple[Adjustment, Prior] | None = None
    trouble = ''
    for fraction in FRACTIONS:
        interfaces = {guess.place: guess.start(fraction * nearest) for guess in known.guesses}
        start = replace(known.air, interfaces=interfaces)
        poses = [sunk(pose, view, start) for pose, view in zip(straight, views, strict=True)]
        free, prior = unknowns(start, known.guesses, known.air_covariance, free_cameras)
        try:
            fit = adjust(
                start, poses, views, free, prior, robust=False, sigma=1.0, converged=converged
            )
        except ValueError as error:
            trouble = str(error)
            continue
        if best is None or fit.rms() < 0.999 * best[0].rms():
            best = fit, prior
        if best[0].rms() < GOOD_START:
            break
    if best is None:
        raise CalibrationError(f'no such interface explains the views: {trouble}')
    return best
