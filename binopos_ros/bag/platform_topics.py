"""Which topics of a bag tell how the robot moves that carries the rig."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from binopos_ros.bag.errors import BagError
from binopos_ros.bag.messages import ODOMETRY, TF
from binopos_ros.bag.playback import renaming
from binopos_ros.bag.reader import BagReader
from binopos_ros.bag.rig_topics import PLATFORM_ODOMETRY, TF_NAMES, RigTopics, Role

TYPES = {'odometry': ODOMETRY, 'transforms': TF, 'static transforms': TF}


def with_platform(
    topics: RigTopics, reader: BagReader, source: str, remap: Collection[str] = ()
) -> RigTopics:
    """The rig's topics and those that a `platform.source` needs: 'tf', 'odometry' or 'none'.

    Args:
        topics: of the rig.
        reader: the bag.
        source: where the robot's pose comes from.
        remap: FROM:=TO, names to read the bag's topics under.

    Raises:
        BagError: the bag does not hold them, or holds something else under their names.
    """
    if source == 'none':
        return topics
    odometry = f'{topics.namespace}/{PLATFORM_ODOMETRY}'
    kinds = {name: kind for kind, name in TF_NAMES.items()}
    if source == 'odometry':
        kinds = {odometry: 'odometry'}
    rename = renaming(tuple(remap))
    roles = dict(topics.roles)
    moving = False
    for topic, info in reader.topics.items():
        kind = kinds.get(rename(topic))
        if kind is None or not info.count:
            continue
        if info.type != TYPES[kind]:
            message = f'{reader.path}: {topic} holds {info.type}, not {TYPES[kind]}'
            raise BagError(message)
        roles[topic] = Role(kind, '')
        moving = moving or kind != 'static transforms'
    if not moving:
        there = [topic for topic, info in reader.topics.items() if info.type == ODOMETRY]
        hint = (
            f'--remap {there[0]}:={odometry}'
            if source == 'odometry' and there
            else 'another platform.source'
        )
        message = (
            f'{reader.path}: {next(iter(kinds))} is missing or empty, which platform.source '
            f"'{source}' takes the robot's pose from: give {hint}, or leave fixed_frame empty"
        )
        raise BagError(message)
    return replace(topics, roles=roles)
