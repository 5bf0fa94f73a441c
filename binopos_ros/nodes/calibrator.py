"""The calibrator node: pictures of both cameras in, guidance for taking views out.

Publishes `calibration/overlay/compressed`: both pictures with the board, the coverage so far and
the next thing to do. `binopos calibrate --live` starts it and calibrates when it ends.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import rclpy
from sensor_msgs.msg import CompressedImage, Image

from binopos_ros.bag.messages import stamp_of
from binopos_ros.calibration.live.session import LiveSession
from binopos_ros.calibration.views.pictures import grey_picture
from binopos_ros.detection.images import image_of
from binopos_ros.nodes import messages
from binopos_ros.nodes.shell import StageNode
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES

QUALITY = 80
WAIT = 0.2  # s, in which the worker looks whether the node has ended


class CalibratorNode(StageNode):
    """Hands the newest pair to a session, which works in its own thread at its own pace."""

    def __init__(
        self, session: LiveSession, tell: Callable[[str], None], **node_options: Any
    ) -> None:
        super().__init__('calibrator', **node_options)
        self._session, self._tell = session, tell
        self._matcher: PairMatcher[Any] = PairMatcher()
        self._overlay = self.publisher(CompressedImage, 'calibration/overlay/compressed')
        self._newest: Pair[Any] | None = None
        self._arrived = threading.Condition()
        self._ended = False
        for side in SIDES:
            on_image = partial(self._on_image, side)
            self.subscription(CompressedImage, f'{side}/image_raw/compressed', on_image)
            self.subscription(Image, f'{side}/image_raw', on_image)
        self._worker = threading.Thread(target=self._work, daemon=True)
        self._worker.start()

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        if hasattr(self, '_worker'):
            with self._arrived:
                self._ended = True
                self._arrived.notify()
            self._worker.join()
        super().destroy_node()

    def _on_image(self, side: str, message: CompressedImage | Image) -> None:
        for outcome in self._matcher.add(side, stamp_of(message), message):
            if isinstance(outcome, Pair):
                with self._arrived:
                    self._newest = outcome
                    self._arrived.notify()

    def _work(self) -> None:
        while True:
            with self._arrived:
                while self._newest is None and not self._ended:
                    self._arrived.wait(WAIT)
                if self._ended:
                    return
                pair, self._newest = self._newest, None
            if pair is not None:
                self._judge(pair)
            if self._session.done:
                rclpy.try_shutdown()
                return

    def _judge(self, pair: Pair[Any]) -> None:
        stamp = stamp_of(pair.left)
        try:
            images = [
                grey_picture(image_of(message), stamp_of(message))
                for message in (pair.left, pair.right)
            ]
            overlay, text = self._session.show(f'{stamp / 1e9:.3f}', *images)
        except ValueError as error:
            self._tell(str(error))
            return
        self._tell(text)
        jpeg = cv2.imencode('.jpg', overlay, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
        message = CompressedImage(format='jpeg', data=jpeg)
        message.header = messages.header(stamp, pair.left.header.frame_id)
        if rclpy.ok():
            self._overlay.publish(message)
