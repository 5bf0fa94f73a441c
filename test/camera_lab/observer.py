"""Runs in the guest: hears all that the suite says."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage
from std_srvs.srv import SetBool

TOPICS = {
    'left/image_raw/compressed': CompressedImage,
    'right/image_raw/compressed': CompressedImage,
    'left/camera_info': CameraInfo,
    'right/camera_info': CameraInfo,
    'left/centroid': PoseWithCovarianceStamped,
    'right/centroid': PoseWithCovarianceStamped,
    'target/position': PoseWithCovarianceStamped,
    'target/pose': PoseWithCovarianceStamped,
}
POSE = 'target/pose'
EVERY_MESSAGE = QoSProfile(depth=200)
PATIENCE = 60.0
"""Seconds after which what has not come will not come."""


class Heard(NamedTuple):
    """A message, its stamp (ns), and when it arrived (s, monotonic)."""

    data: bytes
    stamp: int
    arrived: float


class StuckError(RuntimeError):
    """The suite did not do what it should within the time given."""


class Observer:
    """Hears all that the suite says."""

    def __init__(self) -> None:
        rclpy.init()
        self.node = rclpy.create_node('observer', namespace='stereo')
        self.executor = rclpy.executors.SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.kept: list[tuple[str, str, int, bytes]] | None = None
        self.newest: dict[str, Heard] = {}
        self.status: dict[str, str] = {}
        self.stages: dict[str, dict[str, str]] = {}
        self.said = ''
        for topic, kind in TOPICS.items():
            self.node.create_subscription(
                kind, topic, self._keeper(topic, kind), EVERY_MESSAGE, raw=True
            )
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 20)

    def _keeper(self, topic: str, kind: type) -> Callable[[bytes], None]:
        package = 'geometry' if kind is PoseWithCovarianceStamped else 'sensor'
        name = f'{package}_msgs/msg/{kind.__name__}'

        def keep(data: bytes) -> None:
            # A message begins with its header, and that with the stamp.
            seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
            heard = Heard(data, seconds * 10**9 + nanoseconds, time.monotonic())
            self.newest[topic] = heard
            if self.kept is not None:
                self.kept.append((topic, name, heard.stamp, data))

        return keep

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if 'camera' in status.name:
                self.said = status.message
                self.status = {item.key: item.value for item in status.values}
            self.stages[status.name] = {item.key: item.value for item in status.values}

    def spin(self, until: Callable[[], bool], patience: float = PATIENCE) -> bool:
        """Listen until the condition holds; False where it does not in time."""
        deadline = time.monotonic() + patience
        while not until():
            if time.monotonic() > deadline:
                return False
            self.executor.spin_once(timeout_sec=0.05)
        return True

    def expect(self, what: str, until: Callable[[], bool], patience: float = PATIENCE) -> None:
        """Listen until the condition holds.

        :raises StuckError: where it does not in time.
        """
        if not self.spin(until, patience):
            raise StuckError(f'{what} did not come within {patience:g} s')

    def next(self, topic: str, after: int) -> Heard:
        """The first message of a topic that is stamped later than `after` (ns).

        :raises StuckError: where none comes.
        """
        self.expect(topic, lambda: topic in self.newest and self.newest[topic].stamp > after)
        return self.newest[topic]

    def capture(self, start: bool) -> None:
        """Have the camera node start or stop."""
        self._call(SetBool, 'start_capture', SetBool.Request(data=start))

    def set_parameter(self, name: str, value: object) -> str:
        """Set a parameter of the camera node; why it was refused, or ''."""
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        reason: str = self._call(SetParameters, 'camera/set_parameters', request).results[0].reason
        return reason

    def _call(self, kind: type, name: str, request: object) -> Any:
        client = self.node.create_client(kind, name)
        self.expect(f'the service {name}', client.service_is_ready)
        future = client.call_async(request)
        self.expect(f'the answer of {name}', future.done)
        self.node.destroy_client(client)
        return future.result()
