"""Is the refraction counted twice? A calibration made in water, and an interface on top of it.

A camera that was calibrated in water has taken the port's refraction for its own: its focal length
is larger by the water's index. With `interface.*` or a port the rays are bent once more, and
positions are wrong by a third while hardly anything shows: only away from the middle do the two
rays miss each other more than they would without the interface.
"""

from __future__ import annotations

import numpy as np

from binopos_ros.calibration.adjustment.adequacy import better_by
from binopos_ros.calibration.check.daily import BLOCKS, HARMLESS
from binopos_ros.calibration.check.epipolar import epipolar_residuals
from binopos_ros.optics import StereoRig
from binopos_ros.optics.rig_state import RigState

BETTER = 2.5  # standard errors; twelve blocks that all agree give 3.5
MUCH = 2.0  # times as far apart


def counted_twice(
    rig: StereoRig,
    points: np.ndarray,
    residuals: np.ndarray,
    straight_points: np.ndarray,
    straight_residuals: np.ndarray,
) -> str:
    """A sentence where the pairs agree better without the interface than with it; else ''.

    Args:
        rig: with its interfaces.
        points, residuals: as `daily.check` takes them.
        straight_points, straight_residuals: the same without the interfaces.
    """
    good = np.isfinite(points).all(axis=1) & np.isfinite(straight_points).all(axis=1)
    state = RigState.of(rig)
    if not state.interfaces or good.sum() < BLOCKS:
        return ''
    air = RigState(state.cameras, state.rotation, state.translation)
    bent = epipolar_residuals(state, points[good], residuals[good])[0]
    straight = epipolar_residuals(air, straight_points[good], straight_residuals[good])[0]
    squares = [
        np.array([np.mean(block**2) for block in np.array_split(one, BLOCKS)])
        for one in (bent, straight)
    ]
    with_it, without = (float(np.sqrt(one.mean())) for one in squares)
    if with_it < max(MUCH * without, HARMLESS) or better_by(*squares) < BETTER:
        return ''
    return (
        f'the refraction seems to be counted twice: the rays miss each other by {with_it:.2f} px '
        f'with the interface and by {without:.2f} px without it. Were the cameras calibrated in '
        'the water? Then leave interface.* and the ports out (method: straight), or calibrate '
        'the cameras in air'
    )
