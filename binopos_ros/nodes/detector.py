"""The detector node: images of both cameras in, `left/centroid` and `right/centroid` out."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from binopos_ros.detection import Detector, DetectorOptions, JpegImage, RawImage
from binopos_ros.nodes import messages
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.shell import StageNode, run

SIDES = ('left', 'right')


class DetectorNode(StageNode):
    """Finds the red target in the images of both cameras."""

    def __init__(self) -> None:
        super().__init__('detector')
        options = self.declare_options(DetectorOptions, self._configure)
        self.refuse_unknown_parameters()
        self._configure(options)
        self._diagnostics = StageDiagnostics(self, 'stereo cameras')
        self._last_stamp: dict[str, int | None] = dict.fromkeys(SIDES)
        self._centroids = {
            side: self.publisher(PoseWithCovarianceStamped, f'{side}/centroid') for side in SIDES
        }
        for side in SIDES:
            self.subscription(
                CompressedImage, f'{side}/image_raw/compressed', partial(self._on_jpeg, side)
            )
            self.subscription(Image, f'{side}/image_raw', partial(self._on_raw, side))

    def _configure(self, options: DetectorOptions) -> None:
        self._detectors = {side: Detector.from_options(options) for side in SIDES}

    def _on_jpeg(self, side: str, message: CompressedImage) -> None:
        self._detect(side, message.header, JpegImage(message.data))

    def _on_raw(self, side: str, message: Image) -> None:
        image = RawImage(
            message.data, message.width, message.height, message.step, message.encoding
        )
        self._detect(side, message.header, image)

    def _detect(self, side: str, header: Header, image: JpegImage | RawImage) -> None:
        self._diagnostics.received[f'{side}/image_raw'] += 1
        stamp = messages.nanoseconds(header.stamp)
        if stamp == self._last_stamp[side]:
            self._diagnostics.drop(f'{side}: the stamp was repeated')
            return
        self._last_stamp[side] = stamp
        detection = self._detectors[side].detect(image)
        if detection.target is None:
            self._diagnostics.drop(f'{side}: {detection.reason}')
            return
        target = detection.target
        u, v = target.centre
        self._centroids[side].publish(
            messages.pose_message(
                stamp, header.frame_id, (u, v, target.diameter), target.covariance
            )
        )
        self._diagnostics.published += 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the node until it is told to stop; the exit status."""
    return run([DetectorNode], arguments)
