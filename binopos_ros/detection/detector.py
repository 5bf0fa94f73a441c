"""The detector: one per camera, with a memory of where the target was."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from .candidates import Window, find, search_factor
from .centre import measure
from .errors import DetectionError
from .images import ColourFrame, Frame, JpegImage, Picture, RawImage, decode
from .options import DetectorOptions
from .paper import detect_by_extremes
from .target import Candidate, Detection, Target

TRACK_REACH = 3.0
TRACK_LEAST = 12


class Detector:
    """Finds the target in a camera's images, one after another.

    Where the target was, and how it moved, tells where to look first and which of several
    candidates to take. The centre itself is measured from the image alone: it is the same to the
    last digit whether the target was followed or found anew.
    """

    def __init__(self, options: DetectorOptions | None = None, **changes: Any) -> None:
        """Take options, or their values by name. Raises DetectionError for a bad value."""
        try:
            self.options = replace(options or DetectorOptions(), **changes)
        except TypeError as error:
            msg = f'unknown option of the detector: {error}'
            raise DetectionError(msg) from error
        self._last: Target | None = None
        self._motion = np.zeros(2)

    def reset(self) -> None:
        """Forget where the target was."""
        self._last, self._motion = None, np.zeros(2)

    def detect(self, image: JpegImage | RawImage) -> Detection:
        """Find the target in an image; never raises for what the image holds."""
        try:
            frame = decode(image)
        except DetectionError as error:
            return Detection(None, str(error))
        return self.detect_in(frame)

    def detect_in(self, frame: Frame) -> Detection:
        """Find the target in a decoded image."""
        try:
            detection = self._detect(frame)
        except (DetectionError, cv2.error, np.linalg.LinAlgError) as error:
            detection = Detection(None, str(error))
        self._remember(detection.target)
        return detection

    def _detect(self, frame: Frame) -> Detection:
        options = self.options
        if options.method == 'paper':
            return detect_by_extremes(frame, options.paper_red, options.paper_green)
        window = self._predicted(frame)
        if window is not None:
            detection = _measured(frame, window, options)
            if detection.target is not None:
                return replace(detection, tracked=True)
        return _measured(frame, (0, 0, frame.width, frame.height), options)

    def _predicted(self, frame: Frame) -> Window | None:
        """The window in which to look for the target, or None where it is lost."""
        if self._last is None or not self.options.track:
            return None
        centre = self._last.centre + self._motion
        least = TRACK_LEAST * search_factor(frame)
        reach = max(TRACK_REACH * self._last.diameter / 2, least) + np.abs(self._motion)
        low = np.maximum(centre - reach, 0).astype(int)
        high = np.minimum(centre + reach + 1, (frame.width, frame.height)).astype(int)
        if (high - low).min() < 16:
            return None
        return int(low[0]), int(low[1]), int(high[0]), int(high[1])

    def _remember(self, target: Target | None) -> None:
        if target is None:
            self.reset()
            return
        self._motion = np.zeros(2) if self._last is None else target.centre - self._last.centre
        self._last = target


def detect(image_bgr: Picture, **options: Any) -> Target | None:
    """Find the target in a picture.

    image_bgr is (height, width, 3) uint8; options are the fields of DetectorOptions. Gives None
    where there is no target. Raises DetectionError for a bad option or an array of another kind.
    """
    pixels = np.asarray(image_bgr)
    if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3:
        msg = f'image is {pixels.dtype} of shape {pixels.shape}: give (height, width, 3) of uint8'
        raise DetectionError(msg)
    return Detector(**options).detect_in(ColourFrame(pixels)).target


def _measured(frame: Frame, window: Window, options: DetectorOptions) -> Detection:
    candidates, threshold = find(frame, window, options)
    checked: list[Candidate] = []
    for k, each in enumerate(candidates):
        if each.reason:
            checked.append(each)
            continue
        try:
            found = measure(frame, each.outline)
        except DetectionError as error:
            checked.append(replace(each, reason=str(error)))
            continue
        target = Target(
            found.outline.centre, found.covariance, 2 * found.outline.semi_axes[0], found.outline
        )
        rest = (_outranked(other) for other in candidates[k + 1 :])
        return Detection(target, '', (*checked, each, *rest), threshold)
    if not checked:
        reason = f'no red patch of contrast {threshold:.2f} or more'
    else:
        reason = f'no patch is a target; the best: {checked[0].reason}'
    return Detection(None, reason, tuple(checked), threshold)


def _outranked(candidate: Candidate) -> Candidate:
    return candidate if candidate.reason else replace(candidate, reason='another ranks higher')
