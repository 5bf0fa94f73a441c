"""All that is published on one topic, each message once, whatever its publishers offer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from rclpy.event_handler import QoSMessageLostInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile

from binopos_ros.nodes.losses import NUMBER, SENT, Informed
from binopos_ros.nodes.offers import REQUESTED_DEPTH, Request, requests_for

#: Messages of a topic that are remembered: more than two subscriptions lie apart, each of which
#: keeps so many, and than a latched publisher sends again to one that is new.
MEMORY = 4 * REQUESTED_DEPTH


class Hearing:
    """Subscriptions to one topic, as many kinds of them as its publishers need.

    One subscription that asks for little hears every publisher, but loses what reliable ones would
    have sent again, and what latched ones sent before. So each kind of publisher gets its own, and
    what comes by two of them is taken once: the instant at which it was sent and its number tell
    what is the same.

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
        self._recent: dict[tuple[int, int | None], None] = {}

    def adapt(self, offers: Iterable[QoSProfile]) -> None:
        """Hear publishers that offer this too; what is heard already stays."""
        for request in requests_for(offers) - self._requests:
            self.ask(request)

    def ask(self, request: Request) -> None:
        """Subscribe, whether or not anybody publishes yet."""
        self._requests.add(request)

        def on_message(data: bytes, info: Mapping[str, int | None]) -> None:
            if self._is_new(info.get(SENT), info.get(NUMBER)):
                self._take(data)

        def on_lost(info: QoSMessageLostInfo) -> None:
            self._lose(info.total_count_change)

        self._node.create_subscription(
            self._message_class,
            self._topic,
            Informed(on_message),
            request.profile(),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(
                message_lost=on_lost,
                # A publisher that this one does not hear gets another.
                incompatible_qos=lambda _: None,
            ),
        )

    def _is_new(self, sent: int | None, number: int | None) -> bool:
        """Whether no other subscription has brought this message; of one without a name, yes."""
        if not sent:
            return True
        if (sent, number) in self._recent:
            return False
        self._recent[sent, number] = None
        if len(self._recent) > MEMORY:
            del self._recent[next(iter(self._recent))]
        return True
