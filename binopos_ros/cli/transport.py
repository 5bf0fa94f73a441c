"""The middleware's shared memory, made large enough for bursts of images."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import binopos_ros
from binopos_ros.capture.transport import (
    PROFILE_SEGMENT,
    free_shared_memory,
    network_environment,
    profile_environment,
)

PROFILE = Path('config') / 'fastdds.xml'
#: Nodes of the suite, the player and a recorder: each has a segment of its own.
PARTICIPANTS = 6


def transport_environment() -> dict[str, str]:
    """What to add to the environment of nodes, and of this process before it starts ROS.

    Nothing where the user has a profile, where the middleware is another, or where the machine has
    no room for the segments; where there is none for the smallest, what makes do without.
    """
    if network := network_environment(PARTICIPANTS):
        return network
    profile, free = find_profile(), free_shared_memory()
    if profile is None or free is None or free < PARTICIPANTS * PROFILE_SEGMENT:
        return {}
    # A burst of pairs does not fit the default segment even where one image does.
    return profile_environment(profile, PROFILE_SEGMENT)


def find_profile() -> Path | None:
    """The profile of this installation: of a source tree, of colcon or of pip."""
    package = Path(binopos_ros.__file__).resolve().parent
    prefixes = [
        Path(entry) for entry in os.environ.get('AMENT_PREFIX_PATH', '').split(':') if entry
    ]
    shares = [prefix / 'share' / 'binopos_ros' for prefix in (*prefixes, Path(sys.prefix))]
    for folder in (package.parent, *shares):
        if (folder / PROFILE).is_file():
            return folder / PROFILE
    return None
