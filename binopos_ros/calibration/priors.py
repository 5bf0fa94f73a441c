"""Hand measurements from the command line: `--prior NAME=VALUE,SD`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface import InterfaceGuess
from binopos_ros.calibration.state import LEFT_PORT, RIGHT_PORT, SHARED, TARGET_INDEX

PLACES = (SHARED, LEFT_PORT, RIGHT_PORT)
EXAMPLE = 'write NAME=VALUE,SD as in distance=0.80,0.005 (metres)'


def guesses_from(
    indices: Sequence[float],
    thicknesses: Sequence[float],
    ports: bool,
    priors: Sequence[str],
) -> list[InterfaceGuess]:
    """The interfaces as they are known beforehand.

    Args:
        indices: of the media, camera side first.
        thicknesses: of the layers in between (m).
        ports: a port for each camera in place of a shared surface.
        priors: words as 'distance=0.80,0.005'; a name without a place counts for every interface.

    Raises:
        CalibrationError: a word that cannot be read, or media and layers that do not fit.
    """
    if len(indices) != len(thicknesses) + 2:
        raise CalibrationError(
            f'{len(indices)} indices and {len(thicknesses)} thicknesses: give one index per '
            'medium, camera side first, and a thickness for each layer in between'
        )
    guesses = {
        place: InterfaceGuess(place, tuple(indices), tuple(thicknesses))
        for place in ((LEFT_PORT, RIGHT_PORT) if ports else (SHARED,))
    }
    for word in priors:
        name, numbers = _split(word)
        place, _, rest = name.partition('.')
        if place in PLACES and place not in guesses:
            raise CalibrationError(
                f'--prior {word}: there is no {place}; '
                f'{"drop" if ports else "add"} --ports, or name {", ".join(guesses)}'
            )
        chosen = [place] if place in guesses else list(guesses)
        for one in chosen:
            parameter = rest if place in guesses else name
            guesses[one] = _with_prior(guesses[one], parameter, numbers, word)
    return list(guesses.values())


def parse_numbers(text: str, what: str) -> list[float]:
    """'1.0,1.333' -> [1.0, 1.333].

    Raises:
        CalibrationError: something in it is no finite number.
    """
    try:
        numbers = [float(part) for part in text.split(',') if part.strip()]
    except ValueError:
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        raise CalibrationError(f'{what} {text!r}: write numbers with commas between them')
    return numbers


def _split(word: str) -> tuple[str, list[float]]:
    name, equals, values = word.partition('=')
    if not equals or not name.strip():
        raise CalibrationError(f'--prior {word!r}: {EXAMPLE}')
    return name.strip(), parse_numbers(values, f'--prior {name}')


def _with_prior(
    guess: InterfaceGuess, parameter: str, numbers: list[float], word: str
) -> InterfaceGuess:
    wanted = 4 if parameter == 'normal' else 2
    if len(numbers) != wanted:
        form = 'normal=X,Y,Z,DEGREES' if wanted == 4 else EXAMPLE
        raise CalibrationError(f'--prior {word}: {len(numbers)} numbers; {form}')
    *value, deviation = numbers
    changes: dict[str, Any] = {}
    if parameter == 'normal':
        changes['normal'] = tuple(value)
        deviation = math.radians(deviation)
    elif parameter == 'distance':
        changes['distance'] = value[0]
    elif parameter == TARGET_INDEX:
        changes['indices'] = (*guess.indices[:-1], value[0])
    elif parameter.partition('.')[0] in ('thicknesses', 'indices'):
        changes.update(_layer(guess, parameter, value[0], word))
    return replace(guess, deviations={**guess.deviations, parameter: deviation}, **changes)


def _layer(guess: InterfaceGuess, parameter: str, value: float, word: str) -> dict[str, Any]:
    kind, _, number = parameter.partition('.')
    values = list(getattr(guess, kind))
    if not number.isdigit() or int(number) >= len(values):
        raise CalibrationError(
            f'--prior {word}: there is no {parameter}; count from 0 to {len(values) - 1}'
        )
    values[int(number)] = value
    return {kind: tuple(values)}
