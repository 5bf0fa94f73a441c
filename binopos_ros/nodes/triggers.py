"""Services that are called without saying anything: std_srvs/Trigger."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rclpy.node import Node
from std_srvs.srv import Trigger

#: Does it; whether it could, and a word about it.
Control = Callable[[], tuple[bool, str]]


def offer_triggers(node: Node, controls: Mapping[str, Control]) -> None:
    """Offer the services ~/NAME, each of which calls its control."""
    for name, control in controls.items():
        node.create_service(Trigger, f'~/{name}', _answering(control))


def _answering(
    control: Control,
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def callback(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = control()
        return response

    return callback
