"""Is the refraction counted twice? A calibration made in water, and an interface on top of it.

Cameras that were calibrated in water have taken the refraction for their own: their focal lengths
are larger by the water's index. With `interface.*` or a port the rays are bent once more, and
positions are wrong by a third while hardly anything shows. What does show is how far the two rays
of a pair miss each other. Let e be that with the interface and s without it: their difference
g = e - s is what bending adds, and follows from the pixels alone, whatever their noise. If the
interface is right, e is noise and has no part of g; if the refraction was counted already, s is
noise, and e is g and noise. So the part of g in e is 0 or 1, and is found by least squares, beside
a turn of the right camera, for which it could be taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from binopos_ros.calibration.check.daily import BLOCKS, SIGNIFICANT
from binopos_ros.calibration.check.epipolar import epipolar_residuals
from binopos_ros.optics import StereoRig
from binopos_ros.optics.rig_state import RigState


@dataclass(frozen=True)
class Refraction:
    """How much of what the interface adds to the pairs' misses is too much.

    Attributes:
        surplus: 0 where the interface is right, 1 where the refraction is counted twice; nan where
            there is none.
        deviation: its own, from the pairs' scatter in time.
        misses: RMS by which the rays miss each other with the interface and without it (px).
    """

    surplus: float = np.nan
    deviation: float = np.nan
    misses: tuple[float, float] = (np.nan, np.nan)

    @property
    def is_twice(self) -> bool:
        """Whether the pairs say so, and surely."""
        return self.surplus - SIGNIFICANT * self.deviation > 0.5

    @property
    def text(self) -> str:
        """What is wrong or cannot be told; '' where all is well."""
        if self.is_twice:
            with_it, without = self.misses
            return (
                'the refraction seems to be counted twice: the rays miss each other by '
                f'{with_it:.2f} px with the interface and by {without:.2f} px without it. Were '
                'the cameras calibrated in the water? Then leave interface.* and the ports out '
                '(method: straight), or calibrate the cameras in air'
            )
        if self.surplus + SIGNIFICANT * self.deviation > 0.5:
            return (
                'whether the refraction is counted twice, by the cameras and by the interface, '
                'these pairs do not show: record the target in the outer parts of both pictures'
            )
        return ''


def refraction(
    rig: StereoRig,
    points: np.ndarray,
    residuals: np.ndarray,
    straight_points: np.ndarray,
    straight_residuals: np.ndarray,
) -> Refraction:
    """Whether the pairs agree with the interface, or only without it.

    Args:
        rig: with its interfaces.
        points, residuals: as `daily.check` takes them.
        straight_points, straight_residuals: the same without the interfaces.
    """
    good = np.isfinite(points).all(axis=1) & np.isfinite(straight_points).all(axis=1)
    state = RigState.of(rig)
    places = state.last_places
    if good.sum() < BLOCKS or not places:
        return Refraction()
    if state.interfaces[places[0]].indices[0] == state.target_index:
        return Refraction()
    air = RigState(state.cameras, state.rotation, state.translation)
    bent, response = epipolar_residuals(state, points[good], residuals[good])
    straight, _ = epipolar_residuals(air, straight_points[good], straight_residuals[good])
    turns = [state.names.index('rotation.x'), state.names.index('rotation.z')]
    design = np.column_stack([bent - straight, response[:, turns]])
    surplus = _first_share(design, bent)
    # Neighbours in time err together: the scatter of fits that leave out a block each (jackknife).
    blocks = np.array_split(np.arange(len(bent)), BLOCKS)
    without = [_first_share(np.delete(design, b, axis=0), np.delete(bent, b)) for b in blocks]
    deviation = float(np.sqrt((BLOCKS - 1.0) * np.var(without)))
    misses = (float(np.sqrt(np.mean(one**2))) for one in (bent, straight))
    return Refraction(surplus, deviation, (next(misses), next(misses)))


def _first_share(design: np.ndarray, values: np.ndarray) -> float:
    """The least squares share of the first column in the values."""
    return float(np.linalg.lstsq(design, values, rcond=None)[0][0])
