"""Positions and the parts of their covariances, which come on topics of their own, by stamp."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MessageT = TypeVar('MessageT')

#: The parts: what no filter averages away, and what a waving surface makes.
PARTS = ('systematic', 'medium')
#: A position waits for its parts until so many later ones have come.
_PATIENCE = 2


@dataclass(frozen=True)
class Whole(Generic[MessageT]):
    """A position with the parts (3, 3), m^2, that were told of its covariance, by name."""

    stamp: int
    position: MessageT
    parts: dict[str, Array]


@dataclass
class _Waiting(Generic[MessageT]):
    position: MessageT
    expected: Collection[str]
    parts: dict[str, Array] = field(default_factory=dict)


class PartsJoiner(Generic[MessageT]):
    """Hands on each position once its parts are there, in the order in which positions came.

    A part that was lost is taken from the newest one of its kind: it changes slowly.
    """

    def __init__(self) -> None:
        self._waiting: OrderedDict[int, _Waiting[MessageT]] = OrderedDict()
        self._early: dict[str, OrderedDict[int, Array]] = {name: OrderedDict() for name in PARTS}
        self._newest: dict[str, Array] = {}

    def add_position(
        self, stamp: int, position: MessageT, expected: Collection[str]
    ) -> Iterator[Whole[MessageT]]:
        """Take a position in, with the names of the parts that somebody tells of."""
        waiting = _Waiting(position, expected)
        for name, early in self._early.items():
            part = early.pop(stamp, None)
            if part is not None:
                waiting.parts[name] = part
        self._waiting[stamp] = waiting
        yield from self._ready()

    def add_part(self, name: str, stamp: int, part: Array) -> Iterator[Whole[MessageT]]:
        """Take a part in, of the position of that stamp."""
        self._newest[name] = part
        if stamp in self._waiting:
            self._waiting[stamp].parts[name] = part
        else:
            early = self._early[name]
            early[stamp] = part
            while len(early) > _PATIENCE:
                early.popitem(last=False)
        yield from self._ready()

    def _ready(self) -> Iterator[Whole[MessageT]]:
        while self._waiting:
            stamp, first = next(iter(self._waiting.items()))
            missing = [name for name in first.expected if name not in first.parts]
            if missing and len(self._waiting) <= _PATIENCE:
                return
            for name in missing:
                if name in self._newest:
                    first.parts[name] = self._newest[name]
            del self._waiting[stamp]
            yield Whole(stamp, first.position, first.parts)
