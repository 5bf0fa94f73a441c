"""What would explain pictures that no such interface explains: what people mistake."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from binopos_ros.calibration.adjustment.adjust import Adjustment, adjust
from binopos_ros.calibration.adjustment.start import straight_poses
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.guesses import Guess, InterfaceGuess
from binopos_ros.calibration.interface.starts import Known, best_start
from binopos_ros.calibration.views.view import View

#: Above this standard deviation (px) some views are asked what else would explain them.
SUSPECT = 0.35
ENOUGH_TO_ASK = 3
EXPLAINED = 0.6  # of the RMS may be left by an explanation, and no more than 2 SUSPECT
HOPELESS = 3.0  # px
ROUGHLY = 1e-3  # relative decrease of the cost at which an explanation has shown its worth
#: Boards of another size: half to twice, and from the best of them closer and closer.
SCALES = (0.5, 0.6, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4, 1.7, 2.0)
CLOSER = (0.05, 0.025, 0.0125)
SOME_METRES = 2.0  # longer lengths may have been meant in millimetres
MILLI = 1e-3


def refuse_explained(known: Known, views: Sequence[View], rms: float) -> None:
    """Say what is wrong where no interface explains the pictures and something else does.

    Args:
        known: beforehand; views: all of them; rms: by which they miss (px), inf for altogether.

    Raises:
        CalibrationError: swapped cameras, millimetres, pictures in air, a board of another size.
    """
    some = views[:ENOUGH_TO_ASK]
    left = min(EXPLAINED * rms, 2.0 * SUSPECT)
    for error, words in _explanations(known, some):
        if error < left:
            raise CalibrationError(f'{_lead(rms)}; {words}')


def refuse_hopeless(fit: Adjustment) -> None:
    """Give up.

    Raises:
        CalibrationError: the pictures miss the interface by pixels.
    """
    if fit.sigma > HOPELESS:
        raise CalibrationError(
            f'{_lead(fit.rms())}: the pictures of a pair do not belong together, or the cameras '
            'have moved since they were calibrated'
        )


def _lead(rms: float) -> str:
    miss = f': they miss by {rms:.2f} px' if np.isfinite(rms) else ''
    return f'no such interface explains the pictures{miss}'


def _explanations(known: Known, views: Sequence[View]) -> Iterator[tuple[float, str]]:
    """What is left (px) under each, and its words."""
    if len(known.air.cameras) == 2:
        swapped = [replace(view, pixels=view.pixels[::-1]) for view in views]
        yield _error(known, swapped), 'left and right are swapped: swap the two sources'
    error = _error_in_air(known, views)
    yield (
        error,
        f'without any they miss by {error:.2f} px: they were taken in air, take them through the '
        'interface',
    )
    for guesses, words in _in_metres(known.guesses):
        error = _error(replace(known, guesses=guesses), views)
        yield error, f'millimetres were given? with {words} m by {error:.2f} px: give metres'
    scale, error = _best_scale(known, views)
    yield (
        error,
        f"with a board about {scale:.3g} times as large by {error:.2f} px: check the board's size",
    )


def _error(known: Known, views: Sequence[View]) -> float:
    try:
        return best_start(known, views, converged=ROUGHLY)[0].rms()
    except ValueError:
        return np.inf


def _error_in_air(known: Known, views: Sequence[View]) -> float:
    none = np.zeros(len(known.air.names), bool)
    try:
        poses = straight_poses(known.air, views)
        return adjust(known.air, poses, views, none, robust=False, sigma=1.0).rms()
    except ValueError:
        return np.inf


def _in_metres(
    guesses: Sequence[Guess],
) -> Iterator[tuple[list[Guess], str]]:
    """The guesses with their lengths taken for millimetres, where they are long, and words."""
    flat = [guess for guess in guesses if isinstance(guess, InterfaceGuess)]
    distances = [guess.distance or 0.0 for guess in flat]
    thicknesses = [thickness for guess in guesses for thickness in guess.thicknesses]
    if max(distances, default=0.0) > SOME_METRES:
        words = ', '.join(f'distance {MILLI * one:g}' for one in distances if one > SOME_METRES)
        yield [_scaled(guess, 'distance') for guess in guesses], words
    if max(thicknesses, default=0.0) > SOME_METRES:
        words = ', '.join(f'thickness {MILLI * one:g}' for one in thicknesses)
        yield [_scaled(guess, 'thicknesses') for guess in guesses], words
        if max(distances, default=0.0) > SOME_METRES:
            both = [_scaled(_scaled(guess, 'distance'), 'thicknesses') for guess in guesses]
            yield both, f'distance {MILLI * max(distances):g}, {words}'


def _scaled(guess: Guess, what: str) -> Guess:
    deviations = {
        name: MILLI * value if name.startswith(what) else value
        for name, value in guess.deviations.items()
    }
    if what == 'distance':
        if not isinstance(guess, InterfaceGuess):
            return guess
        distance = None if guess.distance is None else MILLI * guess.distance
        return replace(guess, distance=distance, deviations=deviations)
    thin = tuple(MILLI * thickness for thickness in guess.thicknesses)
    return replace(guess, thicknesses=thin, deviations=deviations)


def _best_scale(known: Known, views: Sequence[View]) -> tuple[float, float]:
    """By how much larger the board would be, and what is left then (px)."""

    def error(scale: float) -> float:
        return _error(known, [replace(view, points=scale * view.points) for view in views])

    tried = {scale: error(scale) for scale in SCALES}
    for step in CLOSER:
        best = min(tried, key=lambda one: tried[one])
        tried |= {best * factor: error(best * factor) for factor in (1.0 - step, 1.0 + step)}
    best = min(tried, key=lambda one: tried[one])
    return best, tried[best]
