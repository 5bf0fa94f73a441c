"""Filters by name."""

from __future__ import annotations

from typing import Any

from binopos_ros.smoothing.base import Filter
from binopos_ros.smoothing.cloud_kalman import CloudKalmanFilter
from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.kalman import KalmanFilter
from binopos_ros.smoothing.opponents.bp_kalman import BackPropagationKalmanFilter
from binopos_ros.smoothing.opponents.coloured import ColouredNoiseFilter
from binopos_ros.smoothing.opponents.huber import HuberKalmanFilter
from binopos_ros.smoothing.opponents.median import MovingMedian
from binopos_ros.smoothing.opponents.multiple_models import MultipleModelsFilter
from binopos_ros.smoothing.opponents.random_walk import RandomWalkKalmanFilter
from binopos_ros.smoothing.opponents.sage_husa import SageHusaFilter
from binopos_ros.smoothing.opponents.student_t import StudentTFilter
from binopos_ros.smoothing.opponents.variational_bayes import VariationalBayesFilter
from binopos_ros.smoothing.paper import PaperCloudKalmanFilter
from binopos_ros.smoothing.unfiltered import NoFilter

#: Every filter class by its name.
FILTERS: dict[str, type[Filter[Any]]] = {
    cls.name: cls
    for cls in (
        CloudKalmanFilter,
        PaperCloudKalmanFilter,
        KalmanFilter,
        NoFilter,
        RandomWalkKalmanFilter,
        SageHusaFilter,
        BackPropagationKalmanFilter,
        HuberKalmanFilter,
        StudentTFilter,
        VariationalBayesFilter,
        MultipleModelsFilter,
        ColouredNoiseFilter,
        MovingMedian,
    )
}


def make_filter(name: str = 'cloud-kalman', **options: Any) -> Filter[Any]:
    """Return a new filter by name, with the tuned defaults where no option says otherwise.

    ``make_filter('cloud-kalman', variant='paper')`` is ``make_filter('cloud-kalman-paper')``.
    Raises SmoothingError for an unknown name or option, or a value out of range.
    """
    variant = options.pop('variant', 'default')
    if variant == 'paper' and name == 'cloud-kalman':
        name = 'cloud-kalman-paper'
    elif variant != 'default':
        msg = f'{name} has no variant {variant!r}; cloud-kalman has default and paper'
        raise SmoothingError(msg)
    if name not in FILTERS:
        msg = f'no filter is named {name!r}; known are {", ".join(FILTERS)}'
        raise SmoothingError(msg)
    return FILTERS[name](**options)
