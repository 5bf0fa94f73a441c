"""Smoothing of stamped 3-D positions: the cloud-Kalman filter and those it is compared with.

>>> import numpy as np
>>> smoother = make_filter('cloud-kalman')
>>> state = smoother.step(0.0, [0.1, 0.0, 1.2], 1e-6 * np.eye(3))
>>> state = smoother.step(0.1, [0.1, 0.0, 1.2], 1e-6 * np.eye(3))
>>> print(state.position.round(3), state.reason or 'used')
[0.1 0.  1.2] used
"""

from binopos_ros.smoothing.base import Filter
from binopos_ros.smoothing.cloud_kalman import CloudKalmanFilter
from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.factory import FILTERS, make_filter
from binopos_ros.smoothing.state import FilterState
from binopos_ros.smoothing.whole import Smoothed, smooth

__all__ = [
    'FILTERS',
    'CloudKalmanFilter',
    'Filter',
    'FilterState',
    'Smoothed',
    'SmoothingError',
    'make_filter',
    'smooth',
]
