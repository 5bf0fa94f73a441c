"""Does the calibration still hold? `binopos calibrate check`, from ordinary operation.

A pair of pixels has four numbers, a position three: one is left over, the distance of the two
bent rays from meeting. It must scatter about zero, within the pixels' noise and what the
calibration's own covariance allows. A moved camera shifts or tilts it; a level that has changed
shows only where the surface is slanted against the baseline, so a ruler stays wise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.check.epipolar import epipolar_residuals
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.optics import StereoRig
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RIGHT, RigState

FEWEST_PAIRS = 20
HARMLESS = 0.1  # px; positions do not notice less
SIGNIFICANT = 3.5  # standard deviations
BLOCKS = 12  # neighbours in time err together (waves): means of blocks are nearly independent
FOREIGN = 10.0  # px; beyond it the two pictures show different things


@dataclass(frozen=True)
class DailyCheck:
    """What `check` found.

    Attributes:
        pairs: used.
        mean, scatter: of the epipolar residual along the bent rays (px).
        deviation: of the mean (px), from its scatter in time and the calibration's covariance.
        skew: median distance of the two rays where they pass each other (m).
        pitch, roll: of the right camera against its calibration that explain the residuals best
            (rad), with their standard deviations.
        holds: the verdict.
        text: it, in words.
    """

    pairs: int
    mean: float
    scatter: float
    deviation: float
    skew: float
    pitch: tuple[float, float]
    roll: tuple[float, float]
    holds: bool
    text: str


def check(
    rig: StereoRig,
    points: np.ndarray,
    residuals: np.ndarray,
    covariance: ParameterCovariance | None = None,
) -> DailyCheck:
    """Judge a calibration by the target's pairs of ordinary operation.

    Args:
        rig: as calibrated.
        points: (N, 3) where the pairs' rays meet, rig frame (m), in the order of time; nan where
            a pair gives no position.
        residuals: (N, 4) measured minus computed: left u, v, right u, v (px).
        covariance: of the calibration.

    Raises:
        CalibrationError: fewer than `FEWEST_PAIRS` pairs give a position.
    """
    meet = np.isfinite(points).all(axis=1)
    good = meet & (np.abs(residuals).max(axis=1) < FOREIGN)
    if good.sum() < FEWEST_PAIRS:
        raise CalibrationError(
            f'{int(good.sum())} of {len(points)} pairs give a position, {FEWEST_PAIRS} are '
            'needed: record a longer piece with the target in both pictures'
        )
    points, residuals = points[good], residuals[good]
    state = RigState.of(rig)
    residual, response = epipolar_residuals(state, points, residuals)

    mean, scatter = float(residual.mean()), float(residual.std(ddof=1))
    blocks = np.array([block.mean() for block in np.array_split(residual, BLOCKS)])
    variance = float(blocks.var(ddof=1)) / BLOCKS
    known = (
        covariance.ordered(state.names)
        if covariance is not None
        else np.zeros((len(state.names),) * 2)
    )
    average = response.mean(axis=0)
    deviation = float(np.sqrt(variance + average @ known @ average))
    pitch, roll = _turn(state, residual, response, variance * BLOCKS)
    distance = np.linalg.norm(points, axis=1)
    skew = float(np.median(np.abs(residual) * np.sqrt(2.0) * distance / state.cameras[0].focal[0]))
    harmless_roll = HARMLESS / (0.5 * max(state.cameras[RIGHT].size))
    holds = abs(mean) < max(HARMLESS, SIGNIFICANT * deviation) and abs(roll[0]) < max(
        harmless_roll, SIGNIFICANT * roll[1]
    )
    text = _text(len(residual), mean, scatter, deviation, skew, pitch, roll, holds)
    return DailyCheck(len(residual), mean, scatter, deviation, skew, pitch, roll, holds, text)


def _turn(
    state: RigState, residual: np.ndarray, response: np.ndarray, block_variance: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Pitch and roll of the right camera from residuals, with the scatter of `BLOCKS` blocks."""
    columns = [state.names.index('rotation.x'), state.names.index('rotation.z')]
    design = response[:, columns]
    inverse = np.linalg.pinv(design.T @ design)
    angles = inverse @ design.T @ residual
    rest = residual - design @ angles
    effective = max(float(rest.var()), block_variance * len(residual) / BLOCKS)
    spreads = np.sqrt(np.diag(inverse) * effective)
    return (float(angles[0]), float(spreads[0])), (float(angles[1]), float(spreads[1]))


def _text(
    pairs: int,
    mean: float,
    scatter: float,
    deviation: float,
    skew: float,
    pitch: tuple[float, float],
    roll: tuple[float, float],
    holds: bool,
) -> str:
    figures = (
        f'{pairs} pairs: epipolar residual {mean:+.3f} px (+- {deviation:.3f}), scatter '
        f'{scatter:.3f} px, rays {1000 * skew:.2f} mm apart'
    )
    if holds:
        return f'the calibration holds. {figures}'
    return (
        f'the calibration no longer holds. {figures}; as if the right camera had turned by '
        f'{np.degrees(pitch[0]):+.3f} degrees of pitch and {np.degrees(roll[0]):+.3f} of roll: '
        'tighten the mount and run `binopos calibrate stereo` again'
    )
