"""Where what is seen comes from: the live topics, or a bag."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

from binopos_ros.view.screen import Instant

#: Gets what came of a request: whether it could be done, and a word about it.
Answer = Callable[[bool, str], None]


class Look(NamedTuple):
    """What somebody looks at just now."""

    numbers: bool = False
    pictures: bool = False  #: as the cameras made them
    drawings: bool = False  #: with what the detector draws over them
    boards: bool = False  #: of a calibrator


class Source(Protocol):
    """Feeds a page server; called from the server's thread, and never for long."""

    def about(self) -> Mapping[str, Any]:
        """What a page has to know when it opens: its title, its buttons, the length of a bag."""

    def instant(self) -> Instant:
        """Now, in the time that is shown."""

    def more(self) -> Mapping[str, Any]:
        """What a page shows beside the screen, as it is now: the place in a bag, the surface."""

    def look(self, look: Look) -> None:
        """What is looked at has changed: feed that, and nothing that nobody looks at."""

    def ask(self, request: Mapping[str, Any], answer: Answer) -> None:
        """Do what a viewer asks for."""
