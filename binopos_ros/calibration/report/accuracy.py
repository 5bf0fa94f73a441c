"""How accurate a rig's positions are, over its working volume: along the line of sight and across.

A position's covariance is that of the pixels' noise, carried on by the rig, and that of the
calibration's own errors, which are the same in every picture and which no filter takes out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from binopos_ros.calibration.adjustment.positions import position_jacobians
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.report.prediction import ACROSS, ALONG, in_both_pictures
from binopos_ros.optics import FlatInterface
from binopos_ros.optics.rig_state import RigState

FARTHEST, NEAREST = 8.0, 2.0  # baselines, where no volume was given
SPARE = 0.02  # m behind the last surface
HALF_WIDTH = 0.6  # of the distance


@dataclass(frozen=True)
class Spread:
    """Standard deviations of positions (m), nan where a camera does not see them.

    Attributes:
        along: the line of sight from between the cameras.
        across: it, in the worst direction.
    """

    along: np.ndarray
    across: np.ndarray


@dataclass(frozen=True)
class AccuracyMap:
    """A level slice through the working volume.

    Attributes:
        x: (ACROSS,) and z: (ALONG,) in the rig frame (m).
        exact: of a rig that is known exactly; whole: with the calibration's own errors.
            Each (ALONG, ACROSS).
    """

    x: np.ndarray
    z: np.ndarray
    exact: Spread
    whole: Spread


def spreads(
    state: RigState, covariance: np.ndarray, points: np.ndarray, noise: float
) -> tuple[Spread, Spread]:
    """Of an exactly known rig, and with the calibration's own errors.

    Args:
        state: the rig; covariance: (P, P) of its parameters.
        points: (N, 3) rig frame (m).
        noise: standard deviation of a pixel coordinate (px).
    """
    by_pixels, by_parameters = position_jacobians(state, points)
    pixels = noise**2 * by_pixels @ np.swapaxes(by_pixels, 1, 2)
    own = by_parameters @ covariance @ np.swapaxes(by_parameters, 1, 2)
    sight = points + 0.5 * state.rotation.T @ state.translation
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    outside = ~in_both_pictures(state, points)
    return _parted(pixels, sight, outside), _parted(pixels + own, sight, outside)


def _parted(covariance: np.ndarray, sight: np.ndarray, outside: np.ndarray) -> Spread:
    along = np.einsum('ni,nij,nj->n', sight, covariance, sight)
    aside = np.eye(3) - sight[:, :, None] * sight[:, None, :]
    flat = np.where(np.isfinite(covariance), covariance, 0.0)
    across = np.linalg.eigvalsh(aside @ flat @ aside)[:, 2]
    gone = outside | ~np.isfinite(covariance).all(axis=(1, 2))
    return Spread(*(np.where(gone, np.nan, np.sqrt(np.maximum(v, 0.0))) for v in (along, across)))


def working_range(
    state: RigState, near: float | None = None, far: float | None = None
) -> tuple[float, float]:
    """From where to where along the left camera's axis (m), behind what it looks through.

    Raises:
        CalibrationError: nothing lies between the two.
    """
    baseline = float(np.linalg.norm(state.translation))
    surface = max(
        (
            (each.distance + sum(each.thicknesses)) / each.normal[2] + SPARE
            for each in state.interfaces.values()
            if isinstance(each, FlatInterface)
        ),
        default=0.0,
    )
    start = near if near is not None else max(NEAREST * baseline, surface)
    end = far if far is not None else start + (FARTHEST - NEAREST) * baseline
    if not 0.0 < start < end:
        raise CalibrationError(
            f'--near {start:g} --far {end:g}: give metres, the nearer one first, above 0'
        )
    return start, end


def accuracy_map(
    state: RigState, covariance: np.ndarray, noise: float, reach: tuple[float, float]
) -> AccuracyMap:
    """The slice at the height of the left camera.

    Args:
        state, covariance, noise: as in `spreads`.
        reach: nearest and farthest distance (m).

    Raises:
        CalibrationError: the two cameras see nothing of it together.
    """
    centre = -0.5 * float((state.rotation.T @ state.translation)[0])
    x = centre + np.linspace(-HALF_WIDTH, HALF_WIDTH, ACROSS) * reach[1]
    z = np.linspace(*reach, ALONG)
    grid = np.stack(np.meshgrid(x, z), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid[:, 0], np.zeros(len(grid)), grid[:, 1]])
    exact, whole = (
        Spread(one.along.reshape(ALONG, ACROSS), one.across.reshape(ALONG, ACROSS))
        for one in spreads(state, covariance, points, noise)
    )
    if not np.isfinite(whole.along).any():
        raise CalibrationError(
            f'the two cameras see nothing together from {reach[0]:g} to {reach[1]:g} m: give '
            '--near and --far of where the target is'
        )
    return AccuracyMap(x, z, exact, whole)


def with_baseline(state: RigState, factor: float) -> RigState:
    """The rig with its cameras `factor` times as far apart."""
    return replace(state, translation=factor * state.translation)
