"""What waits for one viewer: the newest of each kind, and no more."""

from __future__ import annotations

import asyncio
import time
from collections import deque

from binopos_ros.view.wire import BOARD, Picture

#: Marks that wait for a viewer: a few pairs, as pictures are drawn with the marks of their stamp.
MARKS = 16


class Mailbox:
    """Keeps what one viewer has not been sent yet.

    A viewer that is slow gets fewer pictures, never older ones, and holds up nobody; what it holds
    in memory does not grow. The last picture of a row always comes.

    Attributes
    ----------
    wants_pictures : bool
        Whether the viewer looks at pictures.
    wants_drawn : bool
        Whether it looks at those that the detector has drawn over, and not at the cameras'.
    skipped : int
        Pictures in whose place it got a newer one.

    """

    def __init__(self, picture_rate: float) -> None:
        self.wants_pictures = False
        self.wants_drawn = False
        self.skipped = 0
        self._period = 1 / picture_rate
        self._due: dict[str, float] = {}
        self._pictures: dict[str, Picture] = {}
        self._marks: deque[str] = deque(maxlen=MARKS)
        self._answers: deque[str] = deque(maxlen=MARKS)
        self._something = asyncio.Event()

    def put_picture(self, picture: Picture) -> None:
        """Keep a picture in the place of the one before."""
        of_this_kind = picture.side == BOARD or picture.drawn == self.wants_drawn
        if not (self.wants_pictures and of_this_kind):
            return
        self.skipped += picture.side in self._pictures
        self._pictures[picture.side] = picture
        self._something.set()

    def put_mark(self, words: str) -> None:
        """Keep what is to be drawn over a picture; the oldest go where many wait."""
        if self.wants_pictures:
            self._marks.append(words)
            self._something.set()

    def put_answer(self, words: str) -> None:
        """Keep what answers a request."""
        self._answers.append(words)
        self._something.set()

    async def wait(self, seconds: float) -> None:
        """Wait until something can be sent, or for so long."""
        now = time.monotonic()
        waits = [self._due.get(side, 0.0) - now for side in self._pictures]
        try:
            await asyncio.wait_for(self._something.wait(), max(min([seconds, *waits]), 0.0))
        except (asyncio.TimeoutError, TimeoutError):
            return

    def take(self) -> tuple[list[str], list[Picture]]:
        """Texts and pictures to be sent now; marks before the pictures that they belong to."""
        now = time.monotonic()
        texts = [*self._answers, *self._marks]
        pictures = [
            each for each in self._pictures.values() if self._due.get(each.side, 0.0) <= now
        ]
        for each in pictures:
            del self._pictures[each.side]
            # A period of grace, as pictures do not come evenly.
            due = max(self._due.get(each.side, 0.0), now - self._period)
            self._due[each.side] = due + self._period
        self._answers.clear()
        self._marks.clear()
        self._something.clear()
        return texts, pictures
