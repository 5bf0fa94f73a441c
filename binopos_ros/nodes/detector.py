"""The detector node: images of both cameras in, `left/centroid` and `right/centroid` out."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from functools import partial
from typing import Any

import cv2
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from binopos_ros.arrivals import ArrivalOptions, Arrivals, Picture, Work
from binopos_ros.bag.messages import stamp_of
from binopos_ros.detection import (
    Detection,
    DetectionError,
    DetectorOptions,
    JpegImage,
    RawImage,
    decode,
    decoders,
)
from binopos_ros.detection.both import BothCameras, Look
from binopos_ros.detection.images import image_of
from binopos_ros.detection.overlay import draw
from binopos_ros.nodes import messages
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.pictures import Pictures
from binopos_ros.nodes.shell import StageNode, every_message
from binopos_ros.nodes.triggers import offer_triggers
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.sides import SIDES

OVERLAY_QUALITY = 80
#: px; the size of a picture that the decoder is timed with when the node starts.
USUAL_SIZE = (1280, 960)
#: Seconds between looks for pictures whose partner does not come.
LOOK_AFTER = 0.05


class DetectorNode(StageNode):
    """Finds the red target in the images of both cameras.

    What arrives is brought together by the executor's thread; one of its own, and a process
    beside this one, decode and search the left and the right picture at the same time.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__('detector', **node_options)
        options = self.declare_options(DetectorOptions, self._configure)
        arrival_options = self.declare_options(ArrivalOptions, lambda _: None)
        self._cameras = BothCameras(options)
        self._arrivals: Arrivals[CompressedImage | Image] = Arrivals(arrival_options)
        self._framed = dict.fromkeys(SIDES, True)
        self._newest: dict[str, Detection] = {}
        self._diagnostics = StageDiagnostics(
            self, 'stereo cameras', self._details, self._arrivals.pairs
        )
        self._centroids = {
            side: self.publisher(PoseWithCovarianceStamped, f'{side}/centroid') for side in SIDES
        }
        self._overlays = {
            side: self.publisher(CompressedImage, f'{side}/overlay/compressed') for side in SIDES
        }
        self._log_decoder()
        self._enabled = True
        self._left_alone = 0
        self.create_service(SetBool, '~/enable', self._on_enable)
        offer_triggers(
            self, {'start': partial(self._enable, True), 'stop': partial(self._enable, False)}
        )
        for side in SIDES:
            self.latched_subscription(
                CameraInfo, f'{side}/camera_info', partial(self._on_camera_info, side)
            )
        keep = self.subscription
        if not arrival_options.newest_first:
            keep = partial(keep, profile=every_message())
        self._pictures = {
            side: Pictures(
                self, side, arrival_options.image_transport, partial(self._on_picture, side), keep
            )
            for side in SIDES
        }
        self.every(LOOK_AFTER, self._look_after)
        self._failure: BaseException | None = None
        self._worker = threading.Thread(target=self._work, name='detector', daemon=True)
        self._worker.start()

    def destroy_node(self) -> None:
        """End the threads before what they publish with goes."""
        if hasattr(self, '_worker'):
            self._arrivals.close()
            self._worker.join()
            self._cameras.close()
        super().destroy_node()

    def _log_decoder(self) -> None:
        told = f'JPEGs are decoded by {decoders.told(*USUAL_SIZE)}'
        if decoders.REMEDY:
            self.get_logger().warning(f'{told}: {decoders.REMEDY}')
        else:
            self.get_logger().info(told)

    def _configure(self, options: DetectorOptions) -> None:
        self._cameras.configure(options)

    def _enable(self, enabled: bool) -> tuple[bool, str]:
        """Go on, or leave pictures alone: then they are not even decoded."""
        self._enabled = enabled
        return True, 'detecting' if enabled else 'pictures are left alone'

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = self._enable(request.data)
        return response

    def _on_camera_info(self, side: str, message: CameraInfo) -> None:
        problem = ''
        try:
            self._cameras.set_camera(side, read_camera_info_message(message, side))
        except ValueError as error:
            problem = f'cannot be used: {error}'
        self._diagnostics.judge_input(f'{side}/camera_info', problem)

    def _on_picture(self, side: str, message: CompressedImage | Image) -> None:
        if not self._enabled:
            self._left_alone += 1
            return
        self._diagnostics.received[f'{side}/image_raw'] += 1
        self._count(self._arrivals.add(side, stamp_of(message), message))

    def _look_after(self) -> None:
        if self._failure is not None:
            raise self._failure
        self._count(self._arrivals.look())

    def _count(self, left_out: Iterable[Picture[CompressedImage | Image]]) -> None:
        for picture in left_out:
            self._diagnostics.drop(f'{picture.side}: {picture.outcome}')

    def _work(self) -> None:
        try:
            while (work := self._arrivals.take()) is not None:
                self._see(work)
        except BaseException as error:
            # Told by the executor's thread, which ends the node; nothing may stand still unseen.
            self._failure = error

    def _see(self, work: Work[CompressedImage | Image]) -> None:
        pictures = {picture.side: picture for picture in work}
        headers = {picture.side: picture.item.header for picture in work if picture.item}
        looks = {side: self._look(picture) for side, picture in pictures.items()}
        found = {}
        for side, detection in self._cameras.detect(looks):
            self._publish(pictures[side], headers[side], detection)
            found[side] = detection
        for side, look in looks.items():
            if look.survey:
                self._publish_overlay(side, headers[side], look.image, found[side])
        self._cameras.look_over()

    def _look(self, picture: Picture[CompressedImage | Image]) -> Look:
        watched = self._overlays[picture.side].get_subscription_count() > 0
        return Look(picture.stamp, image_of(picture.item), survey=watched)

    def _publish(
        self, picture: Picture[CompressedImage | Image], header: Header, detection: Detection
    ) -> None:
        side = picture.side
        self._newest[side] = detection
        self._framed[side] = bool(header.frame_id)
        target = detection.target
        if target is None:
            self._diagnostics.drop(f'{side}: {detection.reason}')
        else:
            u, v = target.centre
            self._centroids[side].publish(
                messages.pose_message(
                    picture.stamp, header.frame_id, (u, v, target.diameter), target.covariance
                )
            )
            self._diagnostics.published += 1
        self._arrivals.settle(picture, '' if target is not None else detection.reason)

    def _publish_overlay(
        self, side: str, header: Header, image: JpegImage | RawImage, detection: Detection
    ) -> None:
        try:
            frame = decode(image)
        except DetectionError:
            return
        picture = draw(frame.window(0, 0, frame.width, frame.height), detection)
        _, jpeg = cv2.imencode('.jpg', picture, (cv2.IMWRITE_JPEG_QUALITY, OVERLAY_QUALITY))
        message = CompressedImage(header=header, format='jpeg')
        message.data = jpeg.tobytes()
        self._overlays[side].publish(message)

    def _details(self) -> dict[str, object]:
        details: dict[str, object] = {'Enabled': self._enabled}
        if self._left_alone:
            details['Pictures left alone'] = self._left_alone
        for side, pictures in self._pictures.items():
            details[f'{side}: pictures'] = pictures.form
        for side, count in sorted(self._arrivals.unpaired.copy().items()):
            details[f'Unpaired {side}'] = count
        for side, detection in self._newest.copy().items():
            if not self._framed[side]:
                details[f'{side}: frame_id'] = 'empty: set the frame_id of the driver'
            if math.isfinite(detection.threshold):
                details[f'{side}: contrast wanted'] = f'{detection.threshold:.3f}'
            refused = [each.reason for each in detection.candidates if each.reason]
            details[f'{side}: candidates refused'] = len(refused)
            if refused:
                details[f'{side}: best candidate refused'] = refused[0]
        return details
