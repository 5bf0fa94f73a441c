"""Messages that were sent and never came, and clocks that differ, by what the middleware says.

The event `message_lost` tells only of what the transport knows to be gone: what a subscription's
own full queue pushes out is not told. The numbers show both.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any

from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks

NUMBER = 'publication_sequence_number'
SENT, CAME = 'source_timestamp', 'received_timestamp'
#: Seconds by the clocks of both ends that no message takes: less than none, and far too many.
EARLY, LATE = -0.1, 1.0
#: Publishers of one topic that are followed at a time: one, and one that took its place.
MOST_PUBLISHERS = 4


class Gaps:
    """Counts what is missing in the numbers of a topic's messages.

    Each publisher numbers its own messages by ones. A message is taken for one of the publisher
    whose last number lies nearest below; one that lies below all begins a new one.
    """

    def __init__(self) -> None:
        self._last: list[int] = []

    def add(self, number: int) -> int:
        """Take a message's number in; how many are missing before it."""
        below = [last for last in self._last if last < number]
        if not below:
            self._last = [*self._last, number][-MOST_PUBLISHERS:]
            return 0
        nearest = max(below)
        self._last.remove(nearest)
        self._last.append(number)
        return number - nearest - 1


class Informed:
    """A subscription's callback that is told what the middleware says of each message.

    Args:
        take: gets each message and its info.
    """

    #: rclpy asks a callback how many arguments it takes.
    __signature__ = inspect.Signature(
        [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY)
            for name in ('message', 'info')
        ]
    )

    def __init__(self, take: Callable[[Any, Mapping[str, int | None]], None]) -> None:
        self._informed = take

    def __call__(self, *arguments: Any) -> None:
        """Take a message; the EventsExecutor of rclpy 7.1 gives it and its info as one tuple."""
        message, info = arguments if len(arguments) > 1 else arguments[0]
        self._informed(message, info)


class Counted(Informed):
    """A subscription's callback that counts what was lost, and looks at the clocks of who sends.

    Args:
        take: gets each message.
        lose: gets the number of messages that were lost, where there are any.
    """

    def __init__(self, take: Callable[[Any], None], lose: Callable[[int], None]) -> None:
        super().__init__(self._on_message)
        self._take = take
        self._lose = lose
        self._gaps = Gaps()
        self._numbered = False
        self._least = math.inf

    def clock_trouble(self) -> str:
        """What is wrong with the clock of who sends, by all that came since the last call, or ''.

        The message that took least tells: others may have been held up on their way.
        """
        least, self._least = self._least, math.inf
        if EARLY <= least <= LATE or math.isinf(least):
            return ''
        if least < 0:
            way = f'that is {-least:.1f} s ahead of'
        else:
            way = f'that is {least:.1f} s behind'
        return f"comes by a clock {way} this machine's: let chrony or PTP set both"

    def events(self) -> SubscriptionEventCallbacks:
        """The events of the subscription: they count where the middleware numbers nothing."""
        return SubscriptionEventCallbacks(message_lost=self._on_lost)

    def _on_message(self, message: Any, info: Mapping[str, int | None]) -> None:
        self._count(info)
        sent, came = info.get(SENT), info.get(CAME)
        if sent and came:
            self._least = min(self._least, (came - sent) * 1e-9)
        self._take(message)

    def _count(self, info: Mapping[str, int | None]) -> None:
        number = info.get(NUMBER)
        self._numbered = number is not None
        if number is not None and (lost := self._gaps.add(number)):
            self._lose(lost)

    def _on_lost(self, event: QoSMessageLostInfo) -> None:
        if not self._numbered:
            self._lose(event.total_count_change)
