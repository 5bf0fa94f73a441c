"""The camera node: both cameras' images and calibrations, each with its time of acquisition."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, RegionOfInterest
from std_srvs.srv import SetBool

from binopos_ros.capture.clock import KernelToRos
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.formats import (
    ENCODINGS,
    JPEG_FORMATS,
    jpeg_fault,
    packed,
    raw_fault,
    split_raw,
    split_side_by_side,
)
from binopos_ros.capture.identity import exchanged, memory_file, recall, remember
from binopos_ros.capture.kernel import Kernel
from binopos_ros.capture.options import CaptureOptions
from binopos_ros.capture.recovery import STREAMING
from binopos_ros.capture.rig import BOTH, CaptureRig
from binopos_ros.capture.stream import Frame, copied
from binopos_ros.capture.usb import Camera, find_cameras
from binopos_ros.capture.v4l2 import Format
from binopos_ros.nodes.calibration_services import offer_calibration_services
from binopos_ros.nodes.camera_controls import ControlParameters
from binopos_ros.nodes.diagnostics import StageDiagnostics
from binopos_ros.nodes.messages import header
from binopos_ros.nodes.shell import StageNode
from binopos_ros.nodes.transforms import RightUnderLeft
from binopos_ros.optics.camera_info import CameraInfo as Calibration
from binopos_ros.optics.camera_info import stereo_contradictions, stereo_from_camera_infos
from binopos_ros.optics.camera_info_message import camera_info_fields
from binopos_ros.optics.camera_info_url import name_fault, read_calibration
from binopos_ros.sides import SIDES

WATCH_PERIOD = 0.2


class CameraNode(StageNode):
    """Reads the cameras, publishes what they send, and stays up whatever happens to them.

    :param kernel: where the cameras are, and `look` who is plugged in; this machine's by default.
    """

    def __init__(
        self,
        kernel: Kernel | None = None,
        look: Callable[[], list[Camera]] = find_cameras,
        **node_options: Any,
    ) -> None:
        super().__init__('camera', **node_options)
        self._options: CaptureOptions = self.declare_options(CaptureOptions, self._configure)
        options = self._options
        self._controls = ControlParameters(self, self.get_logger().warning)
        settings = {side: self._controls.given(side) for side in (*SIDES, BOTH)}
        self._calibrations = self._read_calibrations(options)
        self._clock_of_kernel = KernelToRos(lambda: self.get_clock().now().nanoseconds)
        self._rig = CaptureRig(options, self._on_frame, settings, kernel=kernel, look=look)
        self._told = dict.fromkeys(self._rig.cameras, '')
        self._published = dict.fromkeys(SIDES, 0)
        self._faults: dict[tuple[str, str], int] = {}
        self._counted: dict[str, int] = {}
        self._warning = ''
        self._known = recall(memory_file())
        for error in self._rig.check().values():
            self.get_logger().warning(str(error))
        for side, camera in self._rig.cameras.items():
            self._controls.attach(side, camera)
        self._make_publishers(options)
        self._diagnostics = StageDiagnostics(self, self._hardware_id(), self._details)
        for side, calibration in self._calibrations.items():
            self._diagnostics.caution(side, '; '.join(calibration.contradictions()))
        self._judge_pair()
        offer_calibration_services(
            self, urls_of(options), options.view_size, self._calibrations, self._take_calibration
        )
        self.create_service(SetBool, 'start_capture', partial(self._on_capture, start=True))
        self.create_service(SetBool, 'stop_capture', partial(self._on_capture, start=False))
        self.every(WATCH_PERIOD, self._watch)
        self._rig.start()

    def destroy_node(self) -> None:
        """Close the cameras, then the node."""
        if hasattr(self, '_rig'):
            self._rig.stop()
        super().destroy_node()

    def _configure(self, options: CaptureOptions) -> None:
        self._options = options

    def _read_calibrations(self, options: CaptureOptions) -> dict[str, Calibration]:
        found = {
            side: read_calibration(side, url, options.view_size)
            for side, url in urls_of(options).items()
            if url
        }
        if len(found) == len(SIDES):
            stereo_from_camera_infos(found['left'], found['right'])
        for side in SIDES:
            if side not in found:
                self.get_logger().warning(
                    f'{side}.camera_info_url is not set: no {side}/camera_info is published'
                )
        return found

    def _make_publishers(self, options: CaptureOptions) -> None:
        passed_through = options.pixel_format in JPEG_FORMATS and not options.side_by_side
        image = (
            partial(self.publisher, CompressedImage)
            if passed_through
            else partial(self.publisher, Image)
        )
        suffix = '/compressed' if passed_through else ''
        self._images: dict[str, Publisher] = {
            side: image(f'{side}/image_raw{suffix}') for side in SIDES
        }
        self._infos: dict[str, tuple[Publisher, CameraInfo]] = {}
        for side, calibration in self._calibrations.items():
            self._publish_with(side, calibration)
        self._frame_ids = {'left': options.left.frame_id, 'right': options.right.frame_id}
        self._frames: RightUnderLeft | None = None
        if options.publish_tf:
            self._frames = RightUnderLeft(self, (options.left.frame_id, options.right.frame_id))
            self._frames.publish(self._calibrations)

    def _publish_with(self, side: str, calibration: Calibration) -> None:
        """Send this calibration along with the images of a side from now on."""
        known = self._infos.get(side)
        publisher = known[0] if known else self.publisher(CameraInfo, f'{side}/camera_info')
        info = CameraInfo(**camera_info_fields(calibration, RegionOfInterest))
        self._infos[side] = publisher, info

    def _take_calibration(self, side: str, calibration: Calibration) -> None:
        self._calibrations[side] = calibration
        self._publish_with(side, calibration)
        self._diagnostics.caution(side, '; '.join(calibration.contradictions()))
        if self._judge_pair() and self._frames is not None:
            self._frames.publish(self._calibrations)

    def _judge_pair(self) -> bool:
        """Tell what speaks against the pair of calibrations; whether they make a rig at all."""
        if len(self._calibrations) < len(SIDES):
            return False
        left, right = (self._calibrations[side] for side in SIDES)
        try:
            stereo_from_camera_infos(left, right)
            rig, told = True, stereo_contradictions(left, right)
        except ValueError as error:
            # Calibrators commit one side after the other.
            rig, told = False, [str(error)]
        self._diagnostics.caution('pair', '; '.join(told))
        return rig

    def _on_frame(self, source: str, frame: Frame, form: Format) -> None:
        if form.pixel_format in JPEG_FORMATS:
            fault = jpeg_fault(frame.data)
        else:
            fault = raw_fault(frame.data, form.step, form.height)
        if fault:
            self._count_fault(source, fault)
            return
        stamp = self._clock_of_kernel.stamp_ns(frame.stamp_ns, self._options.timestamp_offset)
        try:
            build = split_messages if source == BOTH else image_messages
            messages = build(frame.data, form)
        except CaptureError as error:
            self._count_fault(source, str(error))
            return
        for side, message in zip(SIDES if source == BOTH else (source,), messages, strict=True):
            self._publish(side, message, stamp)

    def _publish(self, side: str, message: CompressedImage | Image, stamp: int) -> None:
        message.header = header(stamp, self._frame_ids[side])
        if side in self._infos:
            publisher, info = self._infos[side]
            info.header = message.header
            publisher.publish(info)
        self._images[side].publish(message)
        self._published[side] += 1

    def _count_fault(self, source: str, reason: str) -> None:
        self._faults[source, reason] = self._faults.get((source, reason), 0) + 1

    def _on_capture(
        self, request: SetBool.Request, response: SetBool.Response, start: bool
    ) -> SetBool.Response:
        if request.data == start:
            self._rig.start()
        else:
            self._rig.stop()
        response.success = True
        response.message = 'capturing' if self._rig.running else 'stopped'
        return response

    def _watch(self) -> None:
        self._clock_of_kernel.measure()
        self._warning = self._rig.equalise() if self._options.lock_exposure else ''
        troubles = []
        for side, camera in self._rig.cameras.items():
            self._controls.describe(side)
            health = camera.health
            trouble = '' if health.state == STREAMING else health.trouble
            if trouble:
                troubles.append(f'{side}: {trouble}')
            if trouble != self._told[side]:
                self._told[side] = trouble
                log = self.get_logger()
                if trouble:
                    log.warning(f'{side}: {trouble}')
                else:
                    log.info(f'{side}: {health.camera} streams. {health.notice}')
            if health.format is not None:
                self._rig.meter.tolerance = self._options.tolerance(health.format.frame_rate)
        self._watch_identities(troubles)
        if not self._rig.running:
            troubles = ['capture is stopped; call start_capture']
        self._diagnostics.errors['cameras'] = '; '.join(troubles)
        self._count()

    def _watch_identities(self, troubles: list[str]) -> None:
        now = self._rig.identities()
        for side, other in (SIDES, SIDES[::-1]):
            if side in self._calibrations and side in now and other in now:
                fault = name_fault(self._calibrations[side], now[side].serial, now[other].serial)
                if fault:
                    troubles.append(f'{side}: {fault}')
        if exchanged(self._known, now):
            troubles.append(
                'left and right have changed places since the last run; exchange left.device and '
                f'right.device, or remove {memory_file()} if this is meant'
            )
        elif set(now) == set(SIDES) and now != self._known:
            self._known = now
            try:
                remember(memory_file(), now)
            except OSError as error:
                self.get_logger().warning(f'the cameras cannot be remembered: {error}')

    def _count(self) -> None:
        drops = {
            f'{side}: {reason}': count for (side, reason), count in self._faults.copy().items()
        }
        for side, camera in self._rig.cameras.items():
            health = camera.health
            self._diagnostics.received[f'{side}/image_raw'] = health.good + health.corrupt
            drops[f'{side}: flagged as damaged by the driver'] = health.corrupt
            drops[f'{side}: lost by the driver'] = health.lost
        for reason, count in drops.items():
            fresh = count - self._counted.get(reason, 0)
            if fresh:
                self._counted[reason] = count
                self._diagnostics.drop(reason, fresh)
        self._diagnostics.published = sum(self._published.values())

    def _hardware_id(self) -> str:
        return ', '.join(camera.name for camera in self._rig.cameras.values())

    def _details(self) -> dict[str, object]:
        details: dict[str, object] = {}
        for side, camera in self._rig.cameras.items():
            health = camera.health
            details[f'{side}: state'] = health.state
            details[f'{side}: camera'] = health.camera or camera.name
            if health.format is not None:
                form = health.format
                details[f'{side}: format'] = f'{form.pixel_format} {form.width}x{form.height}'
                details['Target frequency (Hz)'] = f'{form.frame_rate:.3f}'
            for key, value in (('trouble', health.trouble), ('notice', health.notice)):
                if value:
                    details[f'{side}: {key}'] = value
            details[f'{side}: losses'] = (
                ', '.join(f'{count} {cause}' for cause, count in sorted(health.losses.items()))
                or 'none'
            )
            if health.losses:
                details[f'{side}: last outage (s)'] = f'{health.outage:.3f}'
                details[f'{side}: last recovery (s)'] = f'{health.recovery:.3f}'
        details |= self._pair_details()
        details['Steps of the ROS clock'] = self._clock_of_kernel.steps
        if self._warning:
            details['Warning'] = self._warning
        return details

    def _pair_details(self) -> dict[str, object]:
        meter = self._rig.meter
        details: dict[str, object] = {'Pairs': meter.paired}
        for side, count in meter.unpaired.items():
            details[f'Unpaired {side}'] = count
        skew = meter.skew()
        if skew is not None:
            details['Pair skew, median (ms)'] = f'{1e3 * skew.median:.3f}'
            details['Pair skew, 99th percentile (ms)'] = f'{1e3 * skew.percentile_99:.3f}'
            if not math.isnan(skew.drift):
                details['Clock drift, right to left (ppm)'] = f'{1e6 * skew.drift:.1f}'
        return details


def urls_of(options: CaptureOptions) -> dict[str, str]:
    """The cameras' calibration files by side, '' where none is named."""
    return {'left': options.left.camera_info_url, 'right': options.right.camera_info_url}


# A message that checks its fields adopts an array of bytes; one that does not copies it once more.


def image_messages(data: memoryview, form: Format) -> list[CompressedImage | Image]:
    """One image as the message for it, its bytes copied once."""
    if form.pixel_format in JPEG_FORMATS:
        message = CompressedImage(format='jpeg', check_fields=True)
        message.data = copied(data)
        return [message]
    encoding, _ = ENCODINGS[form.pixel_format]
    image = Image(
        width=form.width,
        height=form.height,
        step=form.step,
        encoding=encoding,
        check_fields=True,
    )
    image.data = copied(data[: form.step * form.height])
    return [image]


def split_messages(data: memoryview, form: Format) -> list[Image]:
    """A side-by-side image as the messages of the left and the right half.

    :raises CaptureError: where a JPEG does not decode.
    """
    if form.pixel_format in JPEG_FORMATS:
        # A JPEG cannot be cut in two without coding it anew, so its halves go out decoded.
        encoding, halves = 'bgr8', split_side_by_side(_decoded(data))
    else:
        encoding, pixel = ENCODINGS[form.pixel_format]
        halves = split_raw(data, form.step, form.height, form.width, pixel)
    messages = []
    for half in halves:
        image = Image(
            height=form.height, width=form.width // 2, encoding=encoding, check_fields=True
        )
        image.data = packed(half)
        image.step = len(image.data) // form.height
        messages.append(image)
    return messages


def _decoded(data: memoryview) -> NDArray[np.uint8]:
    # Only side-by-side streams need it; without OpenCV the node starts sooner and is half as big.
    from binopos_ros.detection.errors import DetectionError
    from binopos_ros.detection.images import decode_jpeg

    try:
        return decode_jpeg(data)
    except DetectionError as error:
        message = 'JPEG does not decode'
        raise CaptureError(message) from error
