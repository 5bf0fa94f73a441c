"""All experiments of an evaluation, one after the other, each kept on disk when it is done."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from binopos_ros import __version__
from binopos_ros.evaluation.comparison import (
    ALL_FILTERS,
    PAPER_FILTERS,
    Scores,
    errors_by_control,
    errors_on,
    scores_on,
)
from binopos_ros.evaluation.media import Salted, salted, transforming, wavy
from binopos_ros.evaluation.settings import Settings
from binopos_ros.evaluation.store import Arrays, Store
from binopos_ros.evaluation.trials.protocols import CONTROLS
from binopos_ros.evaluation.trials.sequences import Sequence, unseen_set
from binopos_ros.smoothing import make_filter
from binopos_ros.smoothing.base import Filter

Array = NDArray[np.float64]


class Progress(Protocol):
    """Opens a progress bar of so many steps; what it yields is called after each."""

    def __call__(self, label: str, steps: int) -> AbstractContextManager[Callable[[], None]]: ...


class Results(NamedTuple):
    """What an evaluation found.

    Attributes:
        settings: its size.
        transforming: method -> (E, frames, 3) errors, m.
        salted: the salt water experiments.
        fluctuating: filter -> (E, frames, 3) errors, m.
        seconds: filter -> time per step, s.
        controls: (C, E, frames, 3) errors, m, by control parameter.
        mixed: filter -> scores on the unseen sequences.
        kinds: kind of path of each unseen sequence.
    """

    settings: Settings
    transforming: dict[str, Array]
    salted: Salted
    fluctuating: dict[str, Array]
    seconds: dict[str, float]
    controls: Array
    mixed: dict[str, Scores]
    kinds: tuple[str, ...]


def evaluate(
    settings: Settings,
    store: Store,
    progress: Progress,
    options: Mapping[str, Mapping[str, Any]] = MappingProxyType({}),
) -> Results:
    """Make what the store does not hold yet; all results.

    `options` are those of filters, by name, that are to be compared otherwise than as tuned.
    """
    filters = {name: make_filter(name, **options.get(name, {})) for name in ALL_FILTERS}
    sizes = f'{__version__} {dataclasses.asdict(settings)}'
    air = store.part('transforming', sizes, lambda: _transforming(settings, progress))
    salt = store.part('inhomogeneous', sizes, lambda: _salted(settings, progress))
    waves = _Waves(settings, progress)
    fluctuating, seconds = {}, {}
    for name in PAPER_FILTERS:
        part = store.part(
            f'fluctuating-{name}',
            f'{sizes} {filters[name].options}',
            lambda name=name: _filtered(filters[name], waves.trials(), progress),  # type: ignore[misc]
        )
        fluctuating[name], seconds[name] = part['errors'], float(part['seconds'])
    paper = make_filter('cloud-kalman', variant='paper')
    controls = store.part(
        'controls', f'{sizes} {paper.options}', lambda: _controls(waves.trials(), progress)
    )
    mixed = {}
    for name in ALL_FILTERS:
        part = store.part(
            f'sequences-{name}',
            f'{sizes} {filters[name].options}',
            lambda name=name: _scores(filters[name], settings, progress),  # type: ignore[misc]
        )
        mixed[name] = Scores(**part)
    kinds = store.part(
        'kinds', sizes, lambda: {'kinds': np.array([s.kind for s in _unseen(settings)])}
    )
    return Results(
        settings,
        air,
        _unpacked(salt),
        fluctuating,
        seconds,
        controls['errors'],
        mixed,
        tuple(str(kind) for kind in kinds['kinds']),
    )


class _Waves:
    """The wavy experiments, made when the first filter asks for them."""

    def __init__(self, settings: Settings, progress: Progress) -> None:
        self._settings = settings
        self._progress = progress
        self._trials: list[Sequence] = []

    def trials(self) -> list[Sequence]:
        if not self._trials:
            count = self._settings.experiments
            with self._progress('waves', count) as tick:
                for number in range(count):
                    self._trials.append(wavy(self._settings, number))
                    tick()
        return self._trials


def _transforming(settings: Settings, progress: Progress) -> Arrays:
    rows = []
    with progress('transforming media', settings.experiments) as tick:
        for number in range(settings.experiments):
            rows.append(transforming(settings, number))
            tick()
    return {method: np.stack([row[method] for row in rows]) for method in rows[0]}


def _salted(settings: Settings, progress: Progress) -> Arrays:
    with progress('inhomogeneous media', settings.experiments) as tick:
        found = salted(settings, tick)
    arrays: Arrays = {
        name: getattr(found, name) for name in ('truth', 'estimate', 'index_std', 'observed')
    }
    for kind in found.errors:
        arrays[f'errors {kind}'] = found.errors[kind]
        arrays[f'single {kind}'] = found.single[kind]
    return arrays


def _unpacked(arrays: Arrays) -> Salted:
    def those(word: str) -> dict[str, Array]:
        return {
            name.removeprefix(f'{word} '): values
            for name, values in arrays.items()
            if name.startswith(f'{word} ')
        }

    return Salted(
        arrays['truth'],
        arrays['estimate'],
        arrays['index_std'],
        arrays['observed'],
        those('errors'),
        those('single'),
    )


def _filtered(smoother: Filter[Any], trials: list[Sequence], progress: Progress) -> Arrays:
    with progress(f'fluctuating media: {smoother.name}', len(trials)) as tick:
        errors, seconds = errors_on(smoother, trials, tick)
    return {'errors': errors, 'seconds': np.array(seconds)}


def _controls(trials: list[Sequence], progress: Progress) -> Arrays:
    with progress('control parameters', len(CONTROLS)) as tick:
        return {'errors': errors_by_control(trials, tick)}


def _scores(smoother: Filter[Any], settings: Settings, progress: Progress) -> Arrays:
    trials = _unseen(settings)
    with progress(f'unseen sequences: {smoother.name}', len(trials)) as tick:
        return dict(scores_on(smoother, trials, tick)._asdict())


def _unseen(settings: Settings) -> tuple[Sequence, ...]:
    return unseen_set(settings.sequences)
