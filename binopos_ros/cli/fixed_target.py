"""Does a target at rest stay where it is while the robot moves? For `binopos calibrate check`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from binopos_ros.bag import BagError, BagReader, messages
from binopos_ros.bag.platform_topics import with_platform
from binopos_ros.bag.rig_topics import RigTopics, TopicChoice
from binopos_ros.cli.calibration_bags import pictured_or_located
from binopos_ros.platform import FixedPosition, Missing, Platform

Array = NDArray[np.float64]

MILLI = 1e3
FEWEST = 20
#: Times as far as stated, beyond which what is stated is not what is wrong.
TOO_FAR = 1.5


def fixed_target_text(
    bag: Path,
    choice: TopicChoice,
    platform: Platform,
    stamps: list[int],
    points: Array,
    covariances: Array,
) -> str:
    """What the positions of a bag say in the platform's fixed frame, in a line.

    Args:
        bag: with the robot's motion.
        choice: which of the bag's topics are the rig's.
        platform: as the smoother's parameters describe it.
        stamps: of the pairs, ns, in the order of time.
        points: (N, 3) m, rig frame; nan where a pair gives none.
        covariances: (N, 3, 3) m^2.

    Raises:
        BagError: the bag does not tell how the robot moved.
    """
    with BagReader(bag) as reader:
        topics = pictured_or_located(reader, choice)
        source = [*topics.of('camera_info', 'left'), *topics.of('image', 'left')]
        rig_frame = str(reader.decode(next(reader.messages(source[:1]))).header.frame_id)
        topics = with_platform(topics, reader, platform.source, choice.remap)
        positions = [
            (stamp, rig_frame, point, covariance)
            for stamp, point, covariance in zip(stamps, points, covariances, strict=True)
            if np.isfinite(point).all()
        ]
        placed = _placed(reader, topics, platform, positions)
    frame = platform.options.fixed_frame
    if len(placed) < FEWEST:
        return f"{frame}: {len(placed)} pairs have the robot's pose, {FEWEST} are needed"
    information, weighted = np.zeros((3, 3)), np.zeros(3)
    for each in placed:
        inverse = np.linalg.inv(each.covariance)
        information += inverse
        weighted += inverse @ each.point
    mean = np.linalg.solve(information, weighted)
    errors = np.array([each.point - mean for each in placed])
    squares = [
        error @ np.linalg.solve(each.covariance, error)
        for error, each in zip(errors, placed, strict=True)
    ]
    scatter = MILLI * float(np.sqrt((errors**2).sum(axis=1).mean()))
    ratio = float(np.sqrt(np.mean(squares) / 3))
    verdict = (
        'as far as stated: mounting and odometry fit the calibration, if the target is at rest'
        if ratio < TOO_FAR
        else 'more than stated: the target moves, or the mounting, the odometry or the '
        'calibration is wrong'
    )
    return f'{frame}: the target scatters by {scatter:.2f} mm, {ratio:.2f} times {verdict}'


def _placed(
    reader: BagReader,
    topics: RigTopics,
    platform: Platform,
    positions: list[tuple[int, str, Array, Array]],
) -> list[FixedPosition]:
    """The positions for which the robot's pose is known, in the fixed frame."""
    kinds = {name: role.kind for name, role in topics.roles.items() if not role.side}
    static = [name for name, kind in kinds.items() if kind == 'static transforms']
    moving = [name for name, kind in kinds.items() if kind in ('transforms', 'odometry')]
    for record in reader.messages(static):
        _tell(platform, 'static transforms', reader.decode(record))
    found = []
    waiting = list(reversed(positions))
    patience = round(platform.options.platform.max_gap * 1e9)
    for record in reader.messages(moving):
        try:
            _tell(platform, kinds[record.topic], reader.decode(record))
        except BagError:
            continue
        while waiting:
            stamp, rig_frame, point, covariance = waiting[-1]
            pose = platform.rig_pose(stamp, rig_frame)
            if isinstance(pose, Missing) and pose.may_come and record.stamp_ns < stamp + patience:
                break
            waiting.pop()
            if not isinstance(pose, Missing):
                found.append(pose.carry(point, covariance))
    return found


def _tell(platform: Platform, kind: str, message: Any) -> None:
    if kind == 'odometry':
        platform.odometry.add(*messages.odometry_of(message))
        return
    for each in messages.transforms_of(message):
        platform.tree.add(*each, static=kind == 'static transforms')
