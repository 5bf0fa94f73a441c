"""One open page: what it is sent, at its own pace."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from binopos_ros.view.mailbox import Mailbox
from binopos_ros.view.screen import Screen
from binopos_ros.view.wire import picture_frame, text

#: s between two states of the numbers.
STATE_PERIOD = 0.1
#: Requests per second that a viewer has reason to send, and how many at once.
REQUEST_RATE, REQUEST_BURST = 20.0, 40.0


class Viewer:
    """Sends a connection what is new to it.

    Args:
        connection: of `websockets`.
        screen: what there is to see.
        numbers: the figures of `Screen.numbers` as they are now.
        mailbox: what else waits for this viewer.
    """

    def __init__(
        self,
        connection: Any,
        screen: Screen,
        numbers: Callable[[], dict[str, Any]],
        mailbox: Mailbox,
    ) -> None:
        self._connection = connection
        self._screen = screen
        self._numbers = numbers
        self._mailbox = mailbox
        self._points = 0
        self._events = 0
        self._allowance = REQUEST_BURST
        self._last_request = time.monotonic()

    def may_ask(self) -> bool:
        """Whether one more request is within what a viewer may send."""
        now = time.monotonic()
        grown = self._allowance + (now - self._last_request) * REQUEST_RATE
        self._allowance = min(grown, REQUEST_BURST) - 1
        self._last_request = now
        return self._allowance >= 0

    async def send_for_ever(self) -> None:
        """Send until the connection closes."""
        due = time.monotonic()
        while True:
            await self._mailbox.wait(max(due - time.monotonic(), 0.0))
            texts, pictures = self._mailbox.take()
            for words in texts:
                await self._connection.send(words)
            for picture in pictures:
                await self._connection.send(picture_frame(picture))
            now = time.monotonic()
            if now >= due:
                due = max(due + STATE_PERIOD, now)
                await self._connection.send(self._state())

    def _state(self) -> str:
        curves, events = self._screen.curves, self._screen.timeline.events
        state = {
            **self._numbers(),
            'skipped': self._mailbox.skipped,
            'curves': curves.since(self._points),
            'events': [each._asdict() for each in events.since(self._events)],
        }
        self._points, self._events = curves.count, events.count
        return text('state', state)
