"""What the smoother hears of the robot that carries the rig."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

from nav_msgs.msg import Odometry

from binopos_ros.bag.messages import odometry_of, transforms_of
from binopos_ros.nodes.shell import StageNode
from binopos_ros.nodes.transforms import TF, TF_STATIC, latched, tf_message
from binopos_ros.platform import Platform
from binopos_ros.reasons import count_reason, kind_of


class PlatformInput:
    """Feeds a platform from the topics that its source names.

    Args:
        node: gets the subscriptions.
        platform: is fed.
        moved: called after each message.

    Raises:
        ParameterError: the source needs a message package that is not installed.
    """

    def __init__(self, node: StageNode, platform: Platform, moved: Callable[[], None]) -> None:
        self._node = node
        self._platform = platform
        self._moved = moved
        self._received = 0
        self._refused: Counter[str] = Counter()
        if not platform.active:
            return
        if platform.options.platform.source == 'odometry':
            node.subscription(Odometry, 'platform/odometry', self._on_odometry)
            return
        kind = tf_message("platform.source 'tf'")
        node.subscription(kind, TF, partial(self._on_transforms, False), sole=False)
        node.create_subscription(kind, TF_STATIC, partial(self._on_transforms, True), latched())

    def details(self) -> dict[str, object]:
        """For the diagnostics: what was heard, and what of it cannot be."""
        if not self._platform.active:
            return {}
        return {
            'Fixed frame': self._platform.options.fixed_frame,
            'Platform messages': self._received,
            **{f'Refused: {reason}': count for reason, count in sorted(self._refused.items())},
        }

    def _on_odometry(self, message: Odometry) -> None:
        self._received += 1
        self._refuse(self._platform.odometry.add(*odometry_of(message)))
        self._moved()

    def _on_transforms(self, static: bool, message: Any) -> None:
        self._received += 1
        for each in transforms_of(message):
            self._refuse(self._platform.tree.add(*each, static=static))
        self._moved()

    def _refuse(self, reason: str) -> None:
        if not reason:
            return
        if kind_of(reason) not in self._refused:
            self._node.get_logger().warning(reason)
        count_reason(self._refused, reason)
