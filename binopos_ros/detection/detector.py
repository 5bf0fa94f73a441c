"""The detector: one per camera, with a memory of where the target was."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from .candidates import find, follow, others
from .centre import measure
from .errors import DetectionError
from .images import ColourFrame, Frame, JpegImage, Picture, RawImage, decode
from .options import DetectorOptions
from .paper import detect_by_extremes
from .target import Candidate, Detection, Target

#: Followed images after which the whole image is searched, and how many such searches in a row
#: must prefer another patch until that is taken. A decoy that was taken while the target was
#: hidden must not be followed for ever.
RECHECK, OUTVOTED = 15, 3


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
        self.reset()

    def reset(self) -> None:
        """Forget where the target was."""
        self._last: Target | None = None
        self._motion = 0.0, 0.0
        self._followed_for = self._votes = 0

    def detect(self, image: JpegImage | RawImage) -> Detection:
        """Find the target in an image; never raises for what the image holds."""
        try:
            frame = decode(image)
        except DetectionError as error:
            return Detection(None, str(error))
        return self.detect_in(frame)

    def detect_in(self, frame: Frame, survey: bool = False) -> Detection:
        """Find the target in a decoded image.

        With `survey`, candidates elsewhere in the image are told of too where the target could be
        followed without a look at them; it takes as long as a search.
        """
        try:
            detection = self._detect(frame, survey)
        except (DetectionError, cv2.error, np.linalg.LinAlgError) as error:
            detection = Detection(None, str(error))
        self._remember(detection.target)
        return detection

    def _detect(self, frame: Frame, survey: bool) -> Detection:
        options = self.options
        if options.method == 'paper':
            return detect_by_extremes(frame, options.paper_red, options.paper_green)
        if self._last is None or not options.track:
            return _measured(frame, *find(frame, options))
        detection = self._followed(frame, self._last)
        if detection.target is None:
            found: tuple[list[Candidate], float] | None = find(frame, options)
        else:
            found = self._outvoting(frame, detection.target)
        if found is not None:
            self._followed_for = self._votes = 0
            return _measured(frame, *found)
        if not survey:
            return detection
        rest = others(frame, detection.candidates[0], options)
        return replace(detection, candidates=(*detection.candidates, *rest))

    def _outvoting(self, frame: Frame, target: Target) -> tuple[list[Candidate], float] | None:
        """What `find` gives, where it has preferred another patch to the followed one for long."""
        self._followed_for += 1
        if self._followed_for % RECHECK:
            return None
        candidates, threshold = find(frame, self.options)
        best = next((each for each in candidates if not each.reason), None)
        elsewhere = best is not None and (
            math.dist(best.outline.centre.tolist(), target.centre.tolist()) > target.diameter
        )
        self._votes = self._votes + 1 if elsewhere else 0
        return (candidates, threshold) if self._votes >= OUTVOTED else None

    def _followed(self, frame: Frame, last: Target) -> Detection:
        """Look for the target where it should be by now."""
        (u, v), (du, dv) = last.centre.tolist(), self._motion
        slack = last.diameter / 4 + max(abs(du), abs(dv)) / 2
        candidate, threshold = follow(frame, (u + du, v + dv), last.diameter, slack, self.options)
        candidates = [] if candidate is None else [candidate]
        return replace(_measured(frame, candidates, threshold), tracked=True)

    def _remember(self, target: Target | None) -> None:
        if target is None:
            self.reset()
            return
        if self._last is not None:
            (u, v), (last_u, last_v) = target.centre.tolist(), self._last.centre.tolist()
            self._motion = u - last_u, v - last_v
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


def _measured(frame: Frame, candidates: list[Candidate], threshold: float) -> Detection:
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
