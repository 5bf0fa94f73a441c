"""A bounded past, from which each reader takes what is new to it."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

T = TypeVar('T')


class Ring(Generic[T]):
    """The newest items, numbered from the first on; a reader remembers the number it has come to.

    A reader that is slow gets all that is still there, at no cost of memory to anybody.
    """

    def __init__(self, size: int) -> None:
        self._items: deque[T] = deque(maxlen=size)
        self.count = 0

    def add(self, item: T) -> None:
        """Add an item; the oldest one goes where there is no more room."""
        self._items.append(item)
        self.count += 1

    def since(self, number: int) -> list[T]:
        """The items from that number on, as far as they are there."""
        first = self.count - len(self._items)
        return list(self._items)[max(number - first, 0) :]

    def clear(self) -> None:
        """Forget the items; numbers go on."""
        self._items.clear()
