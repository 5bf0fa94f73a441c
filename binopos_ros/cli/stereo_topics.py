"""The arguments that say which topics of a bag are the rig's."""

from __future__ import annotations

import argparse
from dataclasses import replace

from binopos_ros.bag import BagReader
from binopos_ros.bag.messages import CAMERA_INFO
from binopos_ros.bag.rig_topics import RigTopics, TopicChoice
from binopos_ros.cli.config import calibration_beside, calibration_in, calibration_of
from binopos_ros.optics import CameraInfo
from binopos_ros.sides import SIDES


def add_topic_arguments(parser: argparse.ArgumentParser, *, sides: bool = True) -> None:
    """Add `--left`, `--right`, `--side-by-side` and `--namespace`.

    `sides`: whether `--left` and `--right` are still to be added.
    """
    for side in SIDES if sides else ():
        parser.add_argument(
            f'--{side}',
            default='',
            metavar='TOPIC',
            help=f"the {side} camera's image topic, where its name does not tell",
        )
    parser.add_argument(
        '--side-by-side',
        default='',
        metavar='TOPIC',
        help='one image topic that shows the left view and, to the right of it, the right one',
    )
    parser.add_argument(
        '--namespace',
        default='',
        metavar='NAMESPACE',
        help="the rig's, where the bag holds more than one",
    )


def add_remap_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--remap`, as `ros2 bag play` has it."""
    parser.add_argument(
        '-m',
        '--remap',
        nargs='+',
        default=(),
        metavar='FROM:=TO',
        help='read topics of the bag under other names',
    )


def rig_of(
    reader: BagReader, arguments: argparse.Namespace
) -> tuple[RigTopics, dict[str, CameraInfo]]:
    """The rig's topics, and its calibration by side where that is not to come from the bag.

    It is that of `--calibration DIR`; or, where the bag holds no camera_info at all, of the files
    left.yaml and right.yaml beside it.

    Raises:
        BagError: no rig is found, or no calibration.
        OpticsError: a calibration cannot be used.
    """
    calibration = calibration_of(arguments)
    recorded = any(info.type == CAMERA_INFO and info.count for info in reader.topics.values())
    beside = () if calibration or recorded else calibration_beside(reader.path)
    if beside:
        calibration = calibration_in(*beside)
    topics = RigTopics.find(reader, choice_of(arguments), calibrated=bool(calibration))
    if beside:
        topics = replace(
            topics, notes=(*topics.notes, f'calibration: {" and ".join(map(str, beside))}')
        )
    if topics.rectified:
        calibration = {side: info.of_rectified_pictures() for side, info in calibration.items()}
    return topics, calibration


def choice_of(arguments: argparse.Namespace) -> TopicChoice:
    """What the arguments say of the bag's topics.

    Raises:
        BagError: they contradict each other.
    """
    return TopicChoice(
        left=str(arguments.left or ''),
        right=str(arguments.right or ''),
        side_by_side=arguments.side_by_side,
        namespace=arguments.namespace,
        remap=tuple(arguments.remap),
    )
