"""Options of the filters: frozen dataclasses whose fields describe and check themselves.

Fields are those of ``binopos_ros.parameters.option``, from which a node declares its parameters.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from binopos_ros.parameters import check_options, option
from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.smoothing.tuned import TUNED

OptionsT = TypeVar('OptionsT', bound='Options')


@dataclasses.dataclass(frozen=True, kw_only=True)
class Options:
    """Base of every filter's options; raises :class:`SmoothingError` on a value not allowed.

    These four guard every filter alike against measurements that no target can have made.
    """

    max_jump: float = option(
        1.0, 'a position further than this from the prediction is refused', 'm', (1e-3, 1e3)
    )
    max_speed: float = option(
        3.0, 'widens max_jump with the time since the last used position', 'm/s', (0.0, 1e3)
    )
    max_gap: float = option(
        2.0,
        'after a longer time without a used position the filter starts afresh',
        's',
        (0.1, 1e4),
    )
    max_delay: float = option(
        0.25, 'a position that is late by up to this is filed in at its own stamp', 's', (0.0, 5.0)
    )
    reacquire_after: float = option(
        0.4,
        'refused positions that agree with each other for this long start the filter afresh',
        's',
        (0.0, 1e3),
    )

    def __post_init__(self) -> None:
        check_options(self, SmoothingError)


def tuned_options(filter_name: str) -> Callable[[type[OptionsT]], type[OptionsT]]:
    """Return the decorator of a filter's options: a frozen dataclass with the tuned defaults.

    A tuned option may be inherited; its description, unit and range are then inherited too.
    """

    def apply(cls: type[OptionsT]) -> type[OptionsT]:
        inherited = {item.name: item for item in dataclasses.fields(cls)}
        for name, value in TUNED.get(filter_name, {}).items():
            source = cls.__dict__.get(name, inherited.get(name))
            if source is None:
                msg = f'tuned.py names the unknown option {name!r} of {filter_name}'
                raise SmoothingError(msg)
            cls.__annotations__.setdefault(name, type(value))
            setattr(cls, name, dataclasses.field(default=value, metadata=source.metadata))
        return dataclasses.dataclass(frozen=True, kw_only=True)(cls)

    return apply


def build(cls: type[OptionsT], filter_name: str, values: Mapping[str, Any]) -> OptionsT:
    """Return options of class `cls`, or raise :class:`SmoothingError` naming what is unknown."""
    known = [item.name for item in dataclasses.fields(cls)]
    unknown = [name for name in values if name not in known]
    if unknown:
        msg = f'{filter_name}: unknown option {unknown[0]!r}; known are {", ".join(sorted(known))}'
        raise SmoothingError(msg)
    try:
        return cls(**values)
    except SmoothingError as error:
        msg = f'{filter_name}: {error}'
        raise SmoothingError(msg) from None
