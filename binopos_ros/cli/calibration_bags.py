"""What `binopos calibrate` takes from bags: pairs of pictures, the target in them, camera_info."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from binopos_ros.bag import BagReader
from binopos_ros.bag.by_stamp import by_stamp
from binopos_ros.bag.layout import is_bag_file
from binopos_ros.bag.messages import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    POSE_WITH_COVARIANCE,
    covariance_of,
    position_of,
    stamp_of,
)
from binopos_ros.bag.rig_topics import BOTH, RigTopics, Role, TopicChoice
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.packed import (
    is_archive,
    is_video,
    open_archive,
    open_halves,
    open_video,
)
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.calibration.views.pictures import PicturePair, Pictures, grey_picture
from binopos_ros.calibration.views.sources import open_files
from binopos_ros.calibration.views.targets import Blob, TargetPair
from binopos_ros.cli.progress import progress
from binopos_ros.cli.recorded_calibration import calibrations
from binopos_ros.detection import Detector, DetectorOptions, Frame, decode
from binopos_ros.detection.images import halves, image_of
from binopos_ros.optics import CameraInfo
from binopos_ros.pairing import Pair, PairMatcher
from binopos_ros.sides import SIDES

CENTROID = 'centroid'


def open_pictures(
    source: Path,
    interval: float = 0.0,
    choice: TopicChoice | None = None,
    layout: str | None = None,
) -> Pictures:
    """Pairs from a folder of pictures, a list of them, an archive, a video, or a bag.

    Args:
        source: as `open_files`, `open_archive` and `open_video` take it; or a bag.
        interval: of a bag or a video, take pairs at least this far apart (s).
        choice: which of a bag's topics are the rig's; None: found by their names.
        layout: how a picture shows both views, where it does.

    Raises:
        CalibrationError: nothing there, or nothing that makes pairs.
        BagError: which topics of the bag are the rig's does not show.
    """
    if not source.exists():
        raise CalibrationError(f'{source} does not exist: give a folder, a list or a bag')
    if is_bag(source):
        return _from_bag(source, interval, choice)
    if is_video(source):
        return open_video(source, interval, layout)
    if is_archive(source):
        return open_archive(source)
    return open_halves(source, layout) if layout and source.is_dir() else open_files(source)


def is_bag(source: Path) -> bool:
    """Whether this is a bag."""
    if source.is_dir():
        return (source / 'metadata.yaml').exists() or any(map(is_bag_file, source.iterdir()))
    return is_bag_file(source)


def target_pairs(
    bag: Path, options: DetectorOptions | None = None, choice: TopicChoice | None = None
) -> list[TargetPair]:
    """The target in every pair of a bag that shows it.

    Args:
        bag: with `left/centroid` and `right/centroid`, or with pictures.
        options: how the target is found in pictures; None: the defaults.
        choice: which of the bag's topics are the rig's; None: found by their names.

    Raises:
        CalibrationError: no pair shows the target.
    """
    pairs = list(_recorded(bag, choice)) or list(_detected(bag, options, choice))
    if not pairs:
        raise CalibrationError(
            f'{bag}: the target is in no pair of pictures: check the lighting, or the options of '
            'the detector'
        )
    return pairs


def camera_infos_of(bag: Path, choice: TopicChoice | None = None) -> tuple[CameraInfo, CameraInfo]:
    """The last usable camera_info of each camera in the bag.

    Raises:
        BagError: there is none.
        OpticsError: there are only such that cannot be used.
    """
    with BagReader(bag) as reader:
        topics = _without_images(reader, choice) or RigTopics.find(reader, choice)
        left, right = (list(calibrations(reader, topics, side))[-1] for side in SIDES)
    return left, right


def pictured_or_located(reader: BagReader, choice: TopicChoice | None) -> RigTopics:
    """The rig's topics in a bag that holds pictures, or nothing but centroids.

    Raises:
        BagError: there is neither.
    """
    return _without_images(reader, choice) or RigTopics.find(reader, choice, calibrated=True)


def _without_images(reader: BagReader, choice: TopicChoice | None) -> RigTopics | None:
    """The calibrations of a bag that holds no images, but centroids; None where it holds some."""
    kinds = {info.type for info in reader.topics.values() if info.count}
    if kinds & {IMAGE, COMPRESSED_IMAGE}:
        return None
    below = _namespace(choice)
    roles = {
        topic: Role('camera_info', side)
        for topic, info in reader.topics.items()
        for side in SIDES
        if info.type == CAMERA_INFO
        and topic.startswith(below)
        and topic.endswith(f'{side}/camera_info')
    }
    return RigTopics(below.rstrip('/'), roles)


def _namespace(choice: TopicChoice | None) -> str:
    """What the names of the rig's topics begin with."""
    return f'/{choice.namespace.strip("/")}/' if choice and choice.namespace else '/'


def _recorded(bag: Path, choice: TopicChoice | None) -> Iterator[TargetPair]:
    namespace = _namespace(choice)
    with BagReader(bag) as reader:
        sides = {
            topic: side
            for topic, info in reader.topics.items()
            for side in SIDES
            if topic.startswith(namespace)
            and topic.endswith(f'/{side}/{CENTROID}')
            and info.type == POSE_WITH_COVARIANCE
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


def _detected(
    bag: Path, options: DetectorOptions | None, choice: TopicChoice | None
) -> Iterator[TargetPair]:
    detectors = [Detector(options) for _ in SIDES]
    for outcome in _paired_images(bag, choice):
        if not isinstance(outcome, Pair):
            continue
        views = zip(detectors, (outcome.left, outcome.right), strict=True)
        targets = [detector.detect_in(view.frame()).target for detector, (_, view) in views]
        left, right = targets
        if left is not None and right is not None:
            yield TargetPair(outcome.left[0], Blob.of(left), Blob.of(right))


def _from_bag(path: Path, interval: float, choice: TopicChoice | None) -> Pictures:
    pairs: list[PicturePair] = []
    unmatched: list[Dropped] = []
    last, stamped = -1e18, False
    for outcome in _paired_images(path, choice):
        stamped |= (outcome.left[0] if isinstance(outcome, Pair) else outcome.stamp) != 0
        if not isinstance(outcome, Pair):
            unmatched.append(
                Dropped(f'{outcome.side} picture at {outcome.stamp / 1e9:.3f}', outcome.reason)
            )
            continue
        (stamp, left), (_, right) = outcome.left, outcome.right
        if stamp / 1e9 - last < interval:
            continue
        last = stamp / 1e9
        pairs.append(PicturePair(f'{stamp / 1e9:.3f}', left.grey, right.grey))
    if not stamped and (pairs or unmatched):
        raise CalibrationError(
            f'{path}: the stamps of all pictures are 0: the driver of the cameras sets none, and '
            'without them nothing tells which pictures are a pair; set the driver up, or save '
            'pictures and give their folder'
        )
    if not pairs:
        reason = f'; {unmatched[0]}' if unmatched else ''
        raise CalibrationError(
            f'{path}: no left and right pictures whose stamps agree{reason}: synchronise the '
            'cameras, or record both'
        )
    return Pictures(tuple(pairs), tuple(unmatched))


@dataclass(frozen=True)
class _View:
    """A camera's view in an image message; half of it where two lie side by side."""

    message: Any
    half: int | None = None

    def frame(self) -> Frame:
        """The view as the detector takes it."""
        frame = decode(image_of(self.message))
        return frame if self.half is None else halves(frame)[self.half]

    def grey(self) -> np.ndarray:
        """The view without colour, (H, W) uint8."""
        picture = grey_picture(image_of(self.message), stamp_of(self.message))
        if self.half is None:
            return picture
        width = picture.shape[1] // 2
        return np.ascontiguousarray(picture[:, self.half * width : (self.half + 1) * width])


def _paired_images(path: Path, choice: TopicChoice | None) -> Iterator[Any]:
    """Pairs and leftovers of (stamp in ns, view), as `pairing` has them."""
    with ExitStack() as stack:
        reader = stack.enter_context(BagReader(path))
        topics = RigTopics.find(reader, choice, calibrated=True)
        matcher: PairMatcher[tuple[int, _View]] = PairMatcher()
        total = sum(reader.topics[topic].count for topic in topics.roles)
        tick = stack.enter_context(progress(f'reading {path.name}', total))
        for record in by_stamp(reader, topics):
            tick()
            role = topics.roles[record.topic]
            if not role.is_image:
                continue
            message = reader.decode(record)
            stamp = stamp_of(message)
            if role.side == BOTH:
                for half, each in enumerate(SIDES):
                    yield from matcher.add(each, stamp, (stamp, _View(message, half)))
            else:
                yield from matcher.add(role.side, stamp, (stamp, _View(message)))
