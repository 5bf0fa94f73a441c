"""The detection stages of both cameras, for pictures that come in pairs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import cv2

from binopos_ros.optics import CameraInfo
from binopos_ros.sides import LEFT, RIGHT

from .apart import StageApart
from .heap import keep_freed_pictures
from .images import JpegImage, RawImage
from .options import DetectorOptions
from .stage import CameraStage, phases_of_pair
from .target import Detection


class Look(NamedTuple):
    """A picture to be looked at: its stamp in nanoseconds, and `survey` of `CameraStage`."""

    stamp: int
    image: JpegImage | RawImage
    survey: bool = False


class BothCameras:
    """Looks at the left and the right picture at the same time: the right one's stage is apart.

    `configure` and `set_camera` may be called by another thread than the rest.
    """

    def __init__(self, options: DetectorOptions) -> None:
        # A core for each camera is what there is; OpenCV's own threads would only wait for one.
        cv2.setNumThreads(1)
        keep_freed_pictures()
        phases = phases_of_pair()
        self._apart = StageApart(options, phases[RIGHT])
        self._here = CameraStage(options, phases[LEFT])

    def configure(self, options: DetectorOptions) -> None:
        """Take new options; where the target was is forgotten."""
        for stage in (self._here, self._apart):
            stage.configure(options)

    def set_camera(self, side: str, info: CameraInfo) -> None:
        """Take the calibration that a camera's images must agree with in size.

        Raises:
            OpticsError: the calibration cannot be used.
        """
        (self._apart if side == RIGHT else self._here).set_camera(info)

    def detect(self, looks: Mapping[str, Look]) -> Iterator[tuple[str, Detection]]:
        """Find the target in a picture of each camera, or of one of them: sides, as they are done.

        Args:
            looks: by side.
        """
        if RIGHT in looks:
            self._apart.begin(*looks[RIGHT])
        if LEFT in looks:
            stamp, image, survey = looks[LEFT]
            yield LEFT, self._here.detect(stamp, self._here.prepare(image), survey)
        if RIGHT in looks:
            yield RIGHT, self._apart.end()

    def look_over(self) -> None:
        """See to what can wait until the answers are out; the right camera's does by itself."""
        self._here.look_over()

    def close(self) -> None:
        """End what is apart."""
        self._apart.close()
