"""Hand measurements from the command line: `--prior NAME=VALUE,SD`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.guesses import DomeGuess, Guess, InterfaceGuess
from binopos_ros.optics.rig_state import LEFT_PORT, RIGHT_PORT, SHARED, TARGET_INDEX

PLACES = (SHARED, LEFT_PORT, RIGHT_PORT)
VECTORS = {'normal': 'normal=X,Y,Z,DEGREES', 'centre': 'centre=X,Y,Z,SD (metres)'}
EXAMPLE = 'write NAME=VALUE,SD as in distance=0.80,0.005 (metres)'


@dataclass(frozen=True)
class Media:
    """Indices of the media, camera side first, and thicknesses of the layers in between (m).

    radius: of the domes that part them (m, inner), None where they are flat.
    """

    indices: Sequence[float]
    thicknesses: Sequence[float] = ()
    radius: float | None = None

    def guess(self, place: str) -> Guess:
        """An interface of which nothing else is known.

        Raises:
            CalibrationError: media and layers do not fit.
        """
        if len(self.indices) != len(self.thicknesses) + 2:
            raise CalibrationError(
                f'{len(self.indices)} indices and {len(self.thicknesses)} thicknesses: give one '
                'index per medium, camera side first, and a thickness for each layer in between'
            )
        media = place, tuple(self.indices), tuple(self.thicknesses)
        return InterfaceGuess(*media) if self.radius is None else DomeGuess(*media, self.radius)


def guesses_from(shared: Media | None, ports: Media | None, priors: Sequence[str]) -> list[Guess]:
    """The interfaces as they are known beforehand.

    Args:
        shared: the surface that both cameras look through, if any.
        ports: those of the two cameras, if any.
        priors: words as 'distance=0.80,0.005'; a name without a place counts for every interface
            where there is no doubt which.

    Raises:
        CalibrationError: a word that cannot be read, or media and layers that do not fit.
    """
    guesses: dict[str, Guess] = {}
    if shared is not None:
        guesses[SHARED] = shared.guess(SHARED)
    if ports is not None:
        guesses |= {place: ports.guess(place) for place in (LEFT_PORT, RIGHT_PORT)}
    for word in priors:
        name, numbers = _split(word)
        place, _, rest = name.partition('.')
        if place in PLACES and place not in guesses:
            raise CalibrationError(
                f'--prior {word}: there is no {place}; '
                f'{"drop" if ports else "add"} --ports, or name {", ".join(guesses)}'
            )
        chosen = [place] if place in guesses else list(guesses)
        if name == TARGET_INDEX and SHARED in guesses:
            chosen = [SHARED]
        elif shared and ports and place not in guesses:
            raise CalibrationError(
                f'--prior {word}: say which: {" or ".join(f"{one}.{name}" for one in guesses)}'
            )
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


def _with_prior(guess: Guess, parameter: str, numbers: list[float], word: str) -> Guess:
    wanted = 4 if parameter in VECTORS else 2
    if len(numbers) != wanted:
        form = VECTORS.get(parameter, EXAMPLE)
        raise CalibrationError(f'--prior {word}: {len(numbers)} numbers; {form}')
    *value, deviation = numbers
    changes: dict[str, Any] = {}
    if parameter in guess.OWN:
        changes[parameter] = tuple(value) if parameter in VECTORS else value[0]
        deviation = math.radians(deviation) if parameter == 'normal' else deviation
    elif parameter == TARGET_INDEX:
        changes['indices'] = (*guess.indices[:-1], value[0])
    elif parameter.partition('.')[0] in ('thicknesses', 'indices'):
        changes.update(_layer(guess, parameter, value[0], word))
    return replace(guess, deviations={**guess.deviations, parameter: deviation}, **changes)


def _layer(guess: Guess, parameter: str, value: float, word: str) -> dict[str, Any]:
    kind, _, number = parameter.partition('.')
    values = list(getattr(guess, kind))
    if not number.isdigit() or int(number) >= len(values):
        raise CalibrationError(
            f'--prior {word}: there is no {parameter}; count from 0 to {len(values) - 1}'
        )
    values[int(number)] = value
    return {kind: tuple(values)}
