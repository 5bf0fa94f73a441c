"""Smoothing of stamped 3-D positions: the cloud-Kalman filter and those it is compared with.

>>> smoother = make_filter('cloud-kalman')
>>> state = smoother.step(stamp, position, covariance)
"""

from binopos_ros.smoothing.base import Filter
from binopos_ros.smoothing.cloud_kalman import CloudKalmanFilter
from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.factory import FILTERS, make_filter
from binopos_ros.smoothing.state import FilterState

__all__ = [
    'FILTERS',
    'CloudKalmanFilter',
    'Filter',
    'FilterState',
    'SmoothingError',
    'make_filter',
]
