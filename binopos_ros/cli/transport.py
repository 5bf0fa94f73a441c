"""The middleware's shared memory, made large enough for bursts of images."""

from __future__ import annotations

from binopos_ros.capture.transport import (
    PROFILE_SEGMENT,
    free_shared_memory,
    network_environment,
    profile_environment,
)
from binopos_ros.cli.installation import PROFILE, find

#: Nodes of the suite, the player and a recorder: each has a segment of its own.
PARTICIPANTS = 6


def transport_environment() -> dict[str, str]:
    """What to add to the environment of nodes, and of this process before it starts ROS.

    Nothing where the user has a profile, where the middleware is another, or where the machine has
    no room for the segments; where there is none for the smallest, what makes do without.
    """
    if network := network_environment(PARTICIPANTS):
        return network
    profile, free = find(PROFILE), free_shared_memory()
    if profile is None or free is None or free < PARTICIPANTS * PROFILE_SEGMENT:
        return {}
    # A burst of pairs does not fit the default segment even where one image does.
    return profile_environment(profile, PROFILE_SEGMENT)
