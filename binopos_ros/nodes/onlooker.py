"""Subscriptions that are there only while somebody looks."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.experimental.events_executor import EventsExecutor

from binopos_ros.nodes.running import SIGNAL_LATENCY
from binopos_ros.nodes.shell import StageNode


class Onlooker:
    """A node of its own, in a thread of its own, that comes and goes.

    A subscription cannot be taken from a node whose executor runs; so the node goes as a whole.

    Args:
        node: beside which it lives, in the same namespace and context.
        name: of the node that comes and goes.
        subscribe: gets it, and makes its subscriptions.
    """

    def __init__(self, node: StageNode, name: str, subscribe: Callable[[StageNode], None]) -> None:
        self._beside = node
        self._name = name
        self._subscribe = subscribe
        self._wanted = threading.Event()
        self._thread: threading.Thread | None = None

    def look(self, wanted: bool) -> None:
        """Begin or end; for one thread alone. What comes late, of one that ends, still comes."""
        if wanted == self._wanted.is_set():
            return
        if wanted:
            self.close()
            self._wanted.set()
            self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
            self._thread.start()
        else:
            self._wanted.clear()

    def close(self) -> None:
        """End, and wait for the end."""
        self._wanted.clear()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        context = self._beside.context
        node = StageNode(
            self._name, context=context, start_parameter_services=False, enable_rosout=False
        )
        executor = EventsExecutor(context=context)
        try:
            self._subscribe(node)
            executor.add_node(node)
            while self._wanted.is_set() and context.ok():
                executor.spin_once(timeout_sec=SIGNAL_LATENCY)
        finally:
            executor.shutdown()
            node.destroy_node()
