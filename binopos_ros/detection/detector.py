"""The detector: one per camera, with a memory of what its images showed.

A frame's way: red patches are found, or followed (`search`), described (`describe`), judged
(`judge`, and by past images `memory`, `standing`), and the best is measured (`measure`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import cv2
import numpy as np

from .describe import describe
from .errors import DetectionError, UnreadableError
from .images import ColourFrame, Frame, JpegImage, Picture, RawImage, prepare
from .judge import Judged, is_same, judge, refused
from .measure import measure
from .memory import Memory
from .options import DetectorOptions, TargetOptions
from .paper import detect_by_extremes
from .search import Sightings, find, follow
from .standing import Standing
from .target import Candidate, Detection, Target

#: In how many followed images the whole of one is looked over, and how many such looks in a row
#: must prefer another patch until that is taken. A decoy that was taken while the target was
#: hidden must not be followed for ever.
LOOK_PERIOD, OUTVOTED = 15, 3

#: What is decoded ahead about a followed target: so many diameters, and px.
FORESEEN, FORESEEN_MARGIN = 1.2, 48


class Detector:
    """Finds the target in a camera's images, one after another.

    Where the target was, and how it moved, tells where to look first and which of several
    candidates to take. The centre itself is measured from the image alone: it is the same to the
    last digit whether the target was followed or found anew.
    """

    def __init__(
        self, options: DetectorOptions | None = None, phase: int = 0, **changes: Any
    ) -> None:
        """Take options, or their values by name; those of the target also as a mapping.

        phase tells after which image of each LOOK_PERIOD followed ones the whole is looked over:
        so that cameras that begin together do not look in the same pair. Raises DetectionError
        for a bad value.
        """
        self._phase = phase
        try:
            if isinstance(changes.get('target'), Mapping):
                changes['target'] = TargetOptions(**changes['target'])
            self.options = replace(options or DetectorOptions(), **changes)
        except TypeError as error:
            msg = f'unknown option of the detector: {error}'
            raise DetectionError(msg) from error
        self.reset()

    def reset(self) -> None:
        """Forget all that the images showed."""
        self._memory = Memory()
        self._standing = Standing(OUTVOTED)
        self._factor = 1
        self._leave()

    def _leave(self) -> None:
        """Follow nothing."""
        self._followed_for = self._votes = 0
        self._to_look_over: Frame | None = None
        self._standing.lost()

    def detect(self, image: JpegImage | RawImage) -> Detection:
        """Find the target in an image; never raises for what the image holds."""
        try:
            frame = self.prepare(image)
        except DetectionError as error:
            return Detection(None, str(error))
        return self.detect_in(frame)

    def prepare(self, image: JpegImage | RawImage, ahead: int = 1) -> Frame:
        """Give an image's frame, with what will be looked at decoded if the target is followed.

        It changes nothing here, so that images can be prepared in threads, `ahead` of the last one
        that was detected in. Raises DetectionError as `images.decode` does.
        """
        last, (du, dv) = self._memory.last, self._memory.motion
        if last is None or not self.options.track or self.options.method == 'paper':
            return prepare(image, None)
        u, v = last.centre.tolist()
        reach = FORESEEN * last.diameter + FORESEEN_MARGIN + ahead * max(abs(du), abs(dv))
        u, v = u + du * (ahead + 1) / 2, v + dv * (ahead + 1) / 2
        return prepare(image, (int(u - reach), int(v - reach), int(u + reach), int(v + reach)))

    def detect_in(self, frame: Frame, survey: bool = False) -> Detection:
        """Find the target in a decoded image.

        With `survey`, candidates elsewhere in the image are told of too where the target could be
        followed without a look at them; it takes as long as a search.
        """
        self.look_over()
        try:
            detection = self._detect(frame, survey)
        except UnreadableError as error:
            # It tells nothing of the target, so it is looked for where it was the next time.
            return Detection(None, str(error))
        except (DetectionError, cv2.error, np.linalg.LinAlgError) as error:
            detection = Detection(None, str(error))
        self._memory.remember(detection.target)
        if detection.target is None:
            self._leave()
        return detection

    def look_over(self) -> None:
        """Look over the whole of the last image, where it is the turn of that.

        It takes as long as a search, so call it once the image's answer is out: the next one would
        wait for it otherwise. What it finds counts from the next image on.
        """
        frame, self._to_look_over = self._to_look_over, None
        last = self._memory.last
        if frame is None or last is None:
            return
        try:
            judged = self._judged(frame, find(frame, self.options))
        except (DetectionError, cv2.error, np.linalg.LinAlgError):
            return
        self._votes = self._votes + 1 if _prefers_another(judged, last) else 0

    def _detect(self, frame: Frame, survey: bool) -> Detection:
        options = self.options
        if options.method == 'paper':
            return detect_by_extremes(frame, options.paper_red, options.paper_green)
        if self._votes >= OUTVOTED:
            # What the looks preferred has lasted through all of them.
            self._memory.forget()
        last = self._memory.last
        if last is None or not options.track:
            return self._found(frame)
        sightings = self._followed(frame, last)
        judged = self._memory.followed(self._judged(frame, sightings))
        detection = measure(frame, judged, sightings.threshold)
        if detection.target is None:
            return self._found(frame)
        self._followed_for += 1
        # By the turn of the period the votes are in, so that the next image is judged by them.
        if (self._followed_for + 1 + self._phase) % LOOK_PERIOD == 0:
            self._to_look_over = frame
            self._standing.look(detection.target, judged[0].description)
        rest = self._elsewhere(frame, judged[0]) if survey else ()
        return replace(detection, candidates=(*detection.candidates, *rest), tracked=True)

    def _found(self, frame: Frame) -> Detection:
        """Look for the target in the whole frame."""
        self._leave()
        sightings = find(frame, self.options)
        self._factor = sightings.factor
        judged = self._judged(frame, sightings)
        if self.options.track:
            judged = self._memory.found(judged, max(frame.width, frame.height))
        return measure(frame, judged, sightings.threshold)

    def _followed(self, frame: Frame, last: Target) -> Sightings:
        """What is seen where the target should be by now."""
        (u, v), (du, dv) = last.centre.tolist(), self._memory.motion
        slack = last.diameter / 4 + max(abs(du), abs(dv)) / 2
        place = u + du, v + dv
        return follow(frame, place, last.diameter, slack, self._factor, self.options)

    def _judged(self, frame: Frame, sightings: Sightings) -> list[Judged]:
        described = (describe(frame, each) for each in sightings.each)
        judged = judge(described, self.options)
        return refused(judged, self._standing.refusal)

    def _elsewhere(self, frame: Frame, chosen: Judged) -> list[Candidate]:
        """The candidates that were passed over because the target was followed."""
        reason = 'the target was followed elsewhere'
        candidates = [
            each.candidate()
            for each in self._judged(frame, find(frame, self.options))
            if not is_same(each.description, chosen.description)
        ]
        return [each if each.reason else replace(each, reason=reason) for each in candidates]


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


def _prefers_another(judged: list[Judged], target: Target) -> bool:
    """Whether the best patch lies elsewhere than the target."""
    best = next((each.description for each in judged if not each.reason), None)
    return best is not None and (
        math.dist(best.outline.centre.tolist(), target.centre.tolist()) > target.diameter
    )
