"""What `binopos calibrate` takes from bags: pairs of pictures, the target in them, camera_info."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import covariance_of, position_of, stamp_of
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.calibration.views.sources import (
    Load,
    PicturePair,
    Pictures,
    grey_picture,
    open_files,
)
from binopos_ros.calibration.views.targets import Blob, TargetPair
from binopos_ros.detection import Detector
from binopos_ros.detection.images import image_of
from binopos_ros.optics import CameraInfo
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES

TOPICS = ('image_raw/compressed', 'image_raw')
CENTROID = 'centroid'


def open_pictures(source: Path, interval: float = 0.0) -> Pictures:
    """Pairs from a folder of pictures, a list of them, or a bag.

    Args:
        source: a folder with left* and right* files or with sub-folders left and right; a text
            file with two paths per line; an OpenCV XML image list, left and right by turns; a bag.
        interval: of a bag, take pairs at least this far apart (s).

    Raises:
        CalibrationError: nothing there, or nothing that makes pairs.
    """
    if not source.exists():
        raise CalibrationError(f'{source} does not exist: give a folder, a list or a bag')
    if _is_bag(source):
        return _from_bag(source, interval)
    return open_files(source)


def _is_bag(source: Path) -> bool:
    """Whether this is a bag."""
    if source.is_dir():
        return (source / 'metadata.yaml').exists() or any(source.glob('*.mcap'))
    return '.mcap' in source.suffixes


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
    for outcome in _paired_images(bag):
        if not isinstance(outcome, Pair):
            continue
        targets = [
            detector.detect(image_of(message)).target
            for detector, (_, message) in zip(
                detectors, (outcome.left, outcome.right), strict=True
            )
        ]
        left, right = targets
        if left is not None and right is not None:
            yield TargetPair(outcome.left[0], Blob.of(left), Blob.of(right))


def _from_bag(path: Path, interval: float) -> Pictures:
    pairs: list[PicturePair] = []
    unmatched: list[Dropped] = []
    last = -1e18
    for outcome in _paired_images(path):
        if not isinstance(outcome, Pair):
            unmatched.append(
                Dropped(f'{outcome.side} picture at {outcome.stamp / 1e9:.3f}', outcome.reason)
            )
            continue
        (stamp, left), (_, right) = outcome.left, outcome.right
        if stamp / 1e9 - last < interval:
            continue
        last = stamp / 1e9
        pairs.append(PicturePair(f'{stamp / 1e9:.3f}', _loader(left), _loader(right)))
    if not pairs:
        reason = f'; {unmatched[0]}' if unmatched else ''
        raise CalibrationError(
            f'{path}: no left and right pictures whose stamps agree{reason}: synchronise the '
            'cameras, or record both'
        )
    return Pictures(tuple(pairs), tuple(unmatched))


def _paired_images(path: Path) -> Iterator[Any]:
    """Pairs and leftovers of (stamp in ns, image message), as `pairing` has them."""
    with BagReader(path) as reader:
        sides: dict[str, str] = {}
        for ending in TOPICS:
            for topic in reader.topics:
                for side in SIDES:
                    if topic.endswith(f'{side}/{ending}') and side not in sides.values():
                        sides[topic] = side
        if len(sides) != 2:
            raise CalibrationError(
                f'{path} holds no pictures of both cameras: topics .../left/{TOPICS[0]} and '
                f'.../right/{TOPICS[0]} (or {TOPICS[1]}) are needed'
            )
        matcher: PairMatcher[tuple[int, Any]] = PairMatcher()
        for record in reader.messages(topics=list(sides)):
            message = reader.decode(record)
            stamp = stamp_of(message)
            yield from matcher.add(sides[record.topic], stamp, (stamp, message))


def _loader(message: Any) -> Load:
    return lambda: grey_picture(image_of(message), stamp_of(message))
