"""What the nodes of other processes say of themselves."""

from __future__ import annotations

import threading
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray


def await_received(topic):
    """Wait until a node says in its diagnostics that it has received something on a topic."""
    heard = threading.Event()

    def look(message):
        values = [item for status in message.status for item in status.values]
        if any(each.key == f'Received {topic}' and int(each.value) for each in values):
            heard.set()

    context = rclpy.Context()
    rclpy.init(context=context)
    node = rclpy.create_node('test_listener', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.create_subscription(DiagnosticArray, '/diagnostics', look, 10)
    end = time.monotonic() + 60
    while not heard.is_set() and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.try_shutdown(context=context)
    assert heard.is_set(), f'nobody received anything on {topic}'
