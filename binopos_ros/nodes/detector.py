"""The detector node: images of both cameras in, `left/centroid` and `right/centroid` out."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import cv2
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from binopos_ros.bag.messages import stamp_of
from binopos_ros.detection import (
    Detection,
    DetectionError,
    DetectorOptions,
    Frame,
    decoders,
)
from binopos_ros.detection.images import image_of
from binopos_ros.detection.overlay import draw
from binopos_ros.detection.stage import OneStream, stages_of_pair, try_decode
from binopos_ros.nodes import messages
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.shell import StageNode
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.sides import SIDES

OVERLAY_QUALITY = 80
#: px; the size of a picture that the decoder is timed with when the node starts.
USUAL_SIZE = (1280, 960)


class DetectorNode(StageNode):
    """Finds the red target in the images of both cameras."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('detector', **node_options)
        options = self.declare_options(DetectorOptions, self._configure)
        self._stages = stages_of_pair(options)
        self._streams = {side: OneStream() for side in SIDES}
        self._framed = dict.fromkeys(SIDES, True)
        self._newest: dict[str, Detection] = {}
        self._diagnostics = StageDiagnostics(self, 'stereo cameras', self._details)
        self._centroids = {
            side: self.publisher(PoseWithCovarianceStamped, f'{side}/centroid') for side in SIDES
        }
        self._overlays = {
            side: self.publisher(CompressedImage, f'{side}/overlay/compressed') for side in SIDES
        }
        self._log_decoder()
        for side in SIDES:
            for kind, form in ((CompressedImage, 'image_raw/compressed'), (Image, 'image_raw')):
                self.subscription(kind, f'{side}/{form}', partial(self._take, side, form))
            self.latched_subscription(
                CameraInfo, f'{side}/camera_info', partial(self._on_camera_info, side)
            )

    def _log_decoder(self) -> None:
        told = f'JPEGs are decoded by {decoders.told(*USUAL_SIZE)}'
        if decoders.REMEDY:
            self.get_logger().warning(f'{told}: {decoders.REMEDY}')
        else:
            self.get_logger().info(told)

    def _configure(self, options: DetectorOptions) -> None:
        for stage in self._stages.values():
            stage.configure(options)

    def _on_camera_info(self, side: str, message: CameraInfo) -> None:
        problem = ''
        try:
            self._stages[side].set_camera(read_camera_info_message(message, side))
        except ValueError as error:
            problem = f'cannot be used: {error}'
        self._diagnostics.judge_input(f'{side}/camera_info', problem)

    def _take(self, side: str, form: str, message: CompressedImage | Image) -> None:
        self._detect(side, form, message)
        self._stages[side].look_over()

    def _detect(self, side: str, form: str, message: CompressedImage | Image) -> None:
        stamp = stamp_of(message)
        if not self._streams[side].takes(form, stamp):
            return
        self._diagnostics.received[f'{side}/image_raw'] += 1
        decoded = try_decode(image_of(message))
        watched = self._overlays[side].get_subscription_count() > 0
        detection = self._stages[side].detect(stamp, decoded, survey=watched)
        self._newest[side] = detection
        self._framed[side] = bool(message.header.frame_id)
        if watched and not isinstance(decoded, DetectionError):
            self._publish_overlay(side, message.header, decoded, detection)
        if detection.target is None:
            self._diagnostics.drop(f'{side}: {detection.reason}')
            return
        target = detection.target
        u, v = target.centre
        self._centroids[side].publish(
            messages.pose_message(
                stamp, message.header.frame_id, (u, v, target.diameter), target.covariance
            )
        )
        self._diagnostics.published += 1

    def _publish_overlay(
        self, side: str, header: Header, frame: Frame, detection: Detection
    ) -> None:
        picture = draw(frame.window(0, 0, frame.width, frame.height), detection)
        _, jpeg = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, OVERLAY_QUALITY))
        message = CompressedImage(header=header, format='jpeg')
        message.data = jpeg.tobytes()
        self._overlays[side].publish(message)

    def _details(self) -> dict[str, object]:
        details: dict[str, object] = {}
        for side, detection in self._newest.items():
            if not self._framed[side]:
                details[f'{side}: frame_id'] = 'empty: set the frame_id of the driver'
            if math.isfinite(detection.threshold):
                details[f'{side}: contrast wanted'] = f'{detection.threshold:.3f}'
            refused = [each.reason for each in detection.candidates if each.reason]
            details[f'{side}: candidates refused'] = len(refused)
            if refused:
                details[f'{side}: best candidate refused'] = refused[0]
        return details
