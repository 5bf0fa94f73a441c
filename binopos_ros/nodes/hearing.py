"""All that is published on one topic, each message once, whatever its publishers offer."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import NamedTuple

from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from binopos_ros.nodes.offers import Request, requests_for

#: Seconds within which two subscriptions bring the same message.
MEMORY = 2.0


class Hearing:
    """Subscriptions to one topic, as many kinds of them as its publishers need.

    One subscription that asks for little hears every publisher, but loses what reliable ones would
    have sent again, and what latched ones sent before. So each kind of publisher gets its own, and
    what comes by two of them is taken once.

    Args:
        node: makes the subscriptions.
        message_class: of the topic.
        topic: its full name.
        take: gets each serialised message.
        lose: gets the number of messages that the transport reports lost.
    """

    def __init__(
        self,
        node: Node,
        message_class: type,
        topic: str,
        take: Callable[[bytes], None],
        lose: Callable[[int], None],
    ) -> None:
        self._node = node
        self._message_class = message_class
        self._topic = topic
        self._take = take
        self._lose = lose
        self._requests: set[Request] = set()
        self._recent: dict[int, _Recent] = {}

    def adapt(self, offers: Iterable[QoSProfile]) -> None:
        """Hear publishers that offer this too; what is heard already stays."""
        for request in requests_for(offers) - self._requests:
            self.ask(request)

    def ask(self, request: Request) -> None:
        """Subscribe, whether or not anybody publishes yet."""
        self._requests.add(request)

        def on_message(data: bytes) -> None:
            if len(self._requests) == 1 or self._is_new(request, data):
                self._take(data)

        def on_lost(info: QoSMessageLostInfo) -> None:
            self._lose(info.total_count_change)

        self._node.create_subscription(
            self._message_class,
            self._topic,
            on_message,
            request.profile(),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=on_lost,
                # A publisher that this one does not hear gets another.
                incompatible_qos=lambda _: None,
            ),
        )

    def _is_new(self, request: Request, data: bytes) -> bool:
        """Whether no other subscription has brought this message as often as this one now has."""
        now = time.monotonic()
        for key in [key for key, each in self._recent.items() if now - each.last > MEMORY]:
            del self._recent[key]
        key = hash(data)
        counts = self._recent[key].counts if key in self._recent else Counter[Request]()
        most = max(counts.values(), default=0)
        counts[request] += 1
        self._recent[key] = _Recent(now, counts)
        return counts[request] > most


class _Recent(NamedTuple):
    """How often each subscription has brought a message, and when it came last."""

    last: float
    counts: Counter[Request]
