"""The target in the pairs of a bag: its centroids, from their topics or detected anew."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.sources import paired_images
from binopos_ros.detection import Detector, JpegImage, RawImage, Target
from binopos_ros.optics import CameraInfo
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES

CENTROID = 'centroid'


@dataclass(frozen=True)
class Blob:
    """The target in one picture: centre (2,) px, covariance (2, 2) px^2, apparent diameter px."""

    centre: np.ndarray
    covariance: np.ndarray
    diameter: float


@dataclass(frozen=True)
class TargetPair:
    """The target in both pictures of an instant; stamp in nanoseconds."""

    stamp: int
    left: Blob
    right: Blob


def target_pairs(bag: Path, options: Mapping[str, Any] | None = None) -> list[TargetPair]:
    """The target in every pair of a bag that shows it.

    Args:
        bag: with `left/centroid` and `right/centroid`, or with pictures.
        options: of the detector, by name, for bags that hold pictures alone.

    Raises:
        CalibrationError: no pair shows the target.
    """
    pairs = list(_recorded(bag)) or list(_detected(bag, options or {}))
    if not pairs:
        raise CalibrationError(
            f'{bag}: the target is in no pair of pictures: check the lighting, or the options of '
            'the detector'
        )
    return pairs


def camera_infos_of(bag: Path) -> tuple[CameraInfo, CameraInfo] | None:
    """The last camera_info of each camera in the bag, None where one is missing."""
    infos: dict[str, CameraInfo] = {}
    with BagReader(bag) as reader:
        topics = [topic for topic in reader.topics if topic.endswith('/camera_info')]
        for record in reader.messages(topics=topics):
            side = record.topic.split('/')[-2]
            infos[side] = read_camera_info_message(reader.decode(record), side)
    if any(side not in infos for side in SIDES):
        return None
    return infos['left'], infos['right']


def _recorded(bag: Path) -> Iterator[TargetPair]:
    with BagReader(bag) as reader:
        sides = {
            topic: topic.split('/')[-2] for topic in reader.topics if topic.endswith(CENTROID)
        }
        matcher: PairMatcher[tuple[int, Blob]] = PairMatcher()
        for record in reader.messages(topics=list(sides)):
            message = reader.decode(record)
            u, v, diameter = position_of(message)
            blob = Blob(np.array([u, v]), covariance_of(message)[:2, :2], float(diameter))
            stamp = stamp_of(message)
            for outcome in matcher.add(sides[record.topic], stamp, (stamp, blob)):
                if isinstance(outcome, Pair):
                    yield TargetPair(outcome.left[0], outcome.left[1], outcome.right[1])


def _detected(bag: Path, options: Mapping[str, Any]) -> Iterator[TargetPair]:
    detectors = [Detector(**options) for _ in SIDES]
    for outcome in paired_images(bag):
        if not isinstance(outcome, Pair):
            continue
        targets = [
            detector.detect(_picture(message)).target
            for detector, (_, message) in zip(
                detectors, (outcome.left, outcome.right), strict=True
            )
        ]
        left, right = targets
        if left is not None and right is not None:
            yield TargetPair(outcome.left[0], _blob(left), _blob(right))


def _picture(message: Any) -> JpegImage | RawImage:
    if not hasattr(message, 'encoding'):
        return JpegImage(message.data)
    return RawImage(message.data, message.width, message.height, message.step, message.encoding)


def _blob(target: Target) -> Blob:
    return Blob(np.asarray(target.centre), np.asarray(target.covariance), float(target.diameter))
