"""The page's buttons: each is a service of another node, called as anybody may call it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any, NamedTuple

from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from binopos_ros.view.source import Answer

#: s that a node has to answer.
PATIENCE = 5.0


class Button(NamedTuple):
    """A button: what it says, and the service behind it."""

    label: str
    service: str
    service_type: type
    request: Any
    key: str  #: that presses it on the page


BUTTONS: Mapping[str, Button] = {
    'reset': Button('Reset filter', 'smoother/reset', Trigger, Trigger.Request(), 'r'),
    'detect': Button('Detector on', 'detector/enable', SetBool, SetBool.Request(data=True), 'd'),
    'rest': Button('Detector off', 'detector/enable', SetBool, SetBool.Request(data=False), 'o'),
    'record': Button('Start recording', 'viewer/start_recording', Trigger, Trigger.Request(), 'c'),
    'stop': Button('Stop recording', 'viewer/stop_recording', Trigger, Trigger.Request(), 'x'),
    'pause': Button('Pause recording', 'recorder/pause', Trigger, Trigger.Request(), 'z'),
    'resume': Button('Resume recording', 'recorder/resume', Trigger, Trigger.Request(), 'v'),
    'snapshot': Button(
        'Write the last seconds', 'recorder/snapshot', Trigger, Trigger.Request(), 's'
    ),
    'still': Button('Save a still pair', 'viewer/save_still', Trigger, Trigger.Request(), 'i'),
}


class Buttons:
    """Presses buttons on behalf of the page.

    Args:
        node: calls the services, relative to its namespace.
    """

    def __init__(self, node: Node) -> None:
        self._clients = {
            name: node.create_client(button.service_type, button.service)
            for name, button in BUTTONS.items()
        }

    def about(self) -> list[dict[str, str]]:
        """What the page shows."""
        return [
            {'name': name, 'label': each.label, 'key': each.key, 'service': each.service}
            for name, each in BUTTONS.items()
        ]

    def press(self, name: str, answer: Answer) -> None:
        """Call the service of a button; the answer comes once, and from any thread."""
        if name not in BUTTONS:
            answer(False, 'there is no such button')
            return
        button, client = BUTTONS[name], self._clients[name]
        if not client.service_is_ready():
            node, _, _ = button.service.partition('/')
            answer(False, f'no {node} runs here; start one, then press again')
            return
        future = client.call_async(button.request)
        impatient = threading.Timer(PATIENCE, future.cancel)
        impatient.daemon = True

        def done(called: Future) -> None:
            impatient.cancel()
            if called.cancelled():
                answer(False, f'{button.service} did not answer within {PATIENCE:g} s')
            else:
                response = called.result()
                answer(bool(response.success), str(response.message))

        future.add_done_callback(done)
        impatient.start()
