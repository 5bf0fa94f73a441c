"""Filters by name."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from binopos_ros.smoothing.errors import SmoothingError

if TYPE_CHECKING:
    from binopos_ros.smoothing.base import Filter

#: Module and class of every filter. Only those that are asked for are imported: a run needs one.
_PLACES = {
    'cloud-kalman': ('cloud_kalman', 'CloudKalmanFilter'),
    'cloud-kalman-paper': ('paper', 'PaperCloudKalmanFilter'),
    'kalman': ('kalman', 'KalmanFilter'),
    'none': ('unfiltered', 'NoFilter'),
    'kalman-random-walk': ('opponents.random_walk', 'RandomWalkKalmanFilter'),
    'sage-husa': ('opponents.sage_husa', 'SageHusaFilter'),
    'bp-kalman': ('opponents.bp_kalman', 'BackPropagationKalmanFilter'),
    'huber': ('opponents.huber', 'HuberKalmanFilter'),
    'student-t': ('opponents.student_t', 'StudentTFilter'),
    'variational-bayes': ('opponents.variational_bayes', 'VariationalBayesFilter'),
    'imm': ('opponents.multiple_models', 'MultipleModelsFilter'),
    'coloured-noise': ('opponents.coloured', 'ColouredNoiseFilter'),
    'median': ('opponents.median', 'MovingMedian'),
}


class _Filters(Mapping[str, 'type[Filter[Any]]']):
    def __getitem__(self, name: str) -> type[Filter[Any]]:
        module, cls = _PLACES[name]
        found: type[Filter[Any]] = getattr(
            importlib.import_module(f'binopos_ros.smoothing.{module}'), cls
        )
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(_PLACES)

    def __len__(self) -> int:
        return len(_PLACES)


#: Every filter class by its name.
FILTERS: Mapping[str, type[Filter[Any]]] = _Filters()


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
