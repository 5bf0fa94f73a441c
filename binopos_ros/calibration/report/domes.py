"""Is a dome worth estimating? What its centre is known to, and what it does to positions."""

from __future__ import annotations

import numpy as np

from binopos_ros.calibration.adjustment.positions import position_jacobians
from binopos_ros.calibration.interface.calibrate import InterfaceCalibration
from binopos_ros.optics import DomePort

#: 95 % quantile of chi-squared with three degrees of freedom: the centre may be the camera's.
CENTRED = 7.815


def dome_verdict(calibration: InterfaceCalibration, place: str) -> str:
    """Say that a dome is not worth estimating, and why; '' where it is, or where there is none.

    It is not where its centre cannot be told from the camera's.
    """
    dome = calibration.state.interfaces[place]
    if not isinstance(dome, DomePort) or calibration.adjustment is None:
        return ''
    names = calibration.state.names
    own = [names.index(f'{place}.centre.{i}') for i in range(3)]
    block = calibration.covariance[np.ix_(own, own)]
    pull = np.linalg.solve(block, dome.centre)
    if dome.centre @ pull > CENTRED:
        return ''
    off = float(np.linalg.norm(dome.centre))
    spread = float(np.sqrt(np.trace(block)))
    words = (
        f'The dome of the {place.replace("_", " ")} is not worth estimating: its centre lies '
        f'{1000 * off:.1f} mm from the camera, +- {1000 * spread:.1f}'
    )
    moved = _moved(calibration, -calibration.covariance[:, own] @ pull)
    if np.isfinite(moved):
        words += f', and positions move by {1000 * moved:.2g} mm with it'
    return f'{words}: take it for centred.'


def _moved(calibration: InterfaceCalibration, change: np.ndarray) -> float:
    """By how much positions where the boards were move (median, m) with a change of parameters.

    The change is that of all parameters if the dome were held in the middle.
    """
    fit = calibration.adjustment
    assert fit is not None
    if len(calibration.state.cameras) < 2:
        return np.nan
    points = np.concatenate(
        [pose.apply(view.points) for view, pose in zip(calibration.views, fit.poses, strict=True)]
    )
    _, by_parameters = position_jacobians(calibration.state, points)
    return float(np.nanmedian(np.linalg.norm(by_parameters @ change, axis=1)))
