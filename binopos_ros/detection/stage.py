"""The detection stage of one camera: images in, detections out, with the checks between messages.

It is the same object in the live node and in `binopos process`, which decodes in threads.
"""

from __future__ import annotations

from binopos_ros.optics import CameraInfo
from binopos_ros.sides import SIDES

from .detector import LOOK_PERIOD, Detector
from .errors import DetectionError
from .images import Frame, JpegImage, RawImage
from .options import DetectorOptions
from .target import Detection


class CameraStage:
    """A detector that knows its camera: stamps must differ, sizes must be the calibration's."""

    def __init__(self, options: DetectorOptions, phase: int = 0) -> None:
        self._phase = phase
        self._info: CameraInfo | None = None
        self._size: tuple[int, int] | None = None
        self._last_stamp: int | None = None
        self.configure(options)

    def configure(self, options: DetectorOptions) -> None:
        """Take new options; where the target was is forgotten."""
        self._detector = Detector(options, self._phase)

    def set_camera(self, info: CameraInfo) -> None:
        """Take the calibration that the images must agree with in size.

        Raises:
            OpticsError: the calibration cannot be used.
        """
        if info != self._info:
            self._size = info.camera().size
            self._info = info

    def prepare(self, image: JpegImage | RawImage, ahead: int = 1) -> Frame | DetectionError:
        """The frame of an image, or why there is none; for use in threads.

        Args:
            image: as it arrived.
            ahead: how many images after the last detected one it is, about.
        """
        try:
            return self._detector.prepare(image, ahead)
        except DetectionError as error:
            return error

    def detect(
        self, stamp: int, decoded: Frame | DetectionError, survey: bool = False
    ) -> Detection:
        """Find the target in one image.

        Args:
            stamp: of the image, nanoseconds.
            decoded: the result of `prepare`.
            survey: whether to tell of candidates elsewhere too; see `Detector.detect_in`.
        """
        if stamp == 0:
            return Detection(None, "the stamp is zero: the camera's driver sets none")
        if stamp == self._last_stamp:
            return Detection(None, 'the stamp was repeated')
        self._last_stamp = stamp
        if isinstance(decoded, DetectionError):
            return Detection(None, str(decoded))
        if self._size not in (None, (decoded.width, decoded.height)):
            calibrated = ' x '.join(map(str, self._size or ()))
            return Detection(
                None,
                f'the image is {decoded.width} x {decoded.height} but its camera_info is for '
                f'{calibrated}: calibrate at this size',
            )
        return self._detector.detect_in(decoded, survey)

    def look_over(self) -> None:
        """See to what can wait until the image's answer is out; see `Detector.look_over`."""
        self._detector.look_over()


def stages_of_pair(options: DetectorOptions) -> dict[str, CameraStage]:
    """Give the stages of both cameras, which take turns in what can wait."""
    return {side: CameraStage(options, phase) for side, phase in phases_of_pair().items()}


def phases_of_pair() -> dict[str, int]:
    """Give the phases by which the cameras of a pair take turns; see `Detector`."""
    return {side: k * LOOK_PERIOD // 2 for k, side in enumerate(SIDES)}
