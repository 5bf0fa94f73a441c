"""What waits for one viewer: the newest of each kind, and no more."""

from __future__ import annotations

import asyncio
import time
from collections import Counter, deque

from binopos_ros.view.wire import Picture

#: Marks that wait for a viewer: a few pairs, as pictures are drawn with the marks of their stamp.
MARKS = 16


class Mailbox:
    """Keeps what one viewer has not been sent yet.

    A viewer that is slow gets fewer pictures, never older ones, and holds up nobody; what it holds
    in memory does not grow.

    Attributes
    ----------
    wants_pictures : bool
        Whether the viewer looks at pictures.
    skipped : Counter
        Pictures it was not sent, by reason.

    """

    def __init__(self, picture_rate: float) -> None:
        self.wants_pictures = False
        self.skipped: Counter[str] = Counter()
        self._period = 1 / picture_rate
        self._due: dict[str, float] = {}
        self._pictures: dict[str, Picture] = {}
        self._marks: deque[str] = deque(maxlen=MARKS)
        self._answers: deque[str] = deque(maxlen=MARKS)
        self._something = asyncio.Event()

    def put_picture(self, picture: Picture) -> None:
        """Keep a picture in the place of the one before, at the rate that is allowed."""
        if not self.wants_pictures:
            return
        now = time.monotonic()
        if now < self._due.get(picture.side, 0.0):
            self.skipped['faster than picture_rate'] += 1
            return
        # A period of grace, as pictures do not come evenly.
        due = max(self._due.get(picture.side, 0.0), now - self._period)
        self._due[picture.side] = due + self._period
        if picture.side in self._pictures:
            self.skipped['the viewer was slower'] += 1
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
        """Wait until there is something, or for so long."""
        try:
            await asyncio.wait_for(self._something.wait(), seconds)
        except (asyncio.TimeoutError, TimeoutError):
            return

    def take(self) -> tuple[list[str], list[Picture]]:
        """Texts and pictures to be sent now; marks before the pictures that they belong to."""
        texts = [*self._answers, *self._marks]
        pictures = list(self._pictures.values())
        self._answers.clear()
        self._marks.clear()
        self._pictures.clear()
        self._something.clear()
        return texts, pictures
