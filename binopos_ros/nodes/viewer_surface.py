"""The surface that the rig looks through, as the triangulator knows it."""

from __future__ import annotations

import math
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

NAMES = ('interface.normal', 'interface.distance')


class Surface:
    """Asks the triangulator where the first surface is; `told` is what a page draws.

    Attributes:
        told: `normal` (unit, rig frame) and `distance` (m, from the left camera); empty where the
            triangulator is not there, or looks through ports alone.
    """

    def __init__(self, node: Node) -> None:
        self.told: dict[str, Any] = {}
        self._client = node.create_client(GetParameters, 'triangulator/get_parameters')
        self._asked: Future | None = None

    def ask(self) -> None:
        """Ask again, as parameters change at run time; nothing where the answer is still due."""
        if not self._client.service_is_ready():
            self.told = {}
            self._asked = None
        elif self._asked is None or self._asked.done():
            self._asked = self._client.call_async(GetParameters.Request(names=NAMES))
            self._asked.add_done_callback(self._take)

    def _take(self, future: Future) -> None:
        answer = future.result()
        values = [parameter_value_to_python(each) for each in answer.values] if answer else []
        if len(values) != len(NAMES) or any(each is None for each in values):
            self.told = {}
            return
        normal, distance = list(values[0]), values[1]
        if len(normal) == 3 and distance and all(map(math.isfinite, [*normal, distance])):
            self.told = {'surface': {'normal': normal, 'distance': distance}}
        else:
            self.told = {}
