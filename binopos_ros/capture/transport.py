"""Whether images fit the middleware's shared memory, and the profile for those that do not."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

DEFAULT_SEGMENT = 512 * 1024
PROFILE_SEGMENT = 64 * 1024 * 1024
"""Bytes of the segment that Fast DDS takes by itself, and by config/fastdds.xml."""

SHARED_MEMORY = '/dev/shm'
TRANSPORTS_VARIABLE = 'FASTDDS_BUILTIN_TRANSPORTS'
#: The name up to Fast DDS 2, which Jazzy has, and from Fast DDS 3 on, which Kilted has: neither
#: reads the other's without a word on stderr.
PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
_OF_FAST_DDS_2 = ('humble', 'iron', 'jazzy')
_RCLPY_OF_FAST_DDS_3 = 8
_OWN_MIDDLEWARE = ('', 'rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp')


def user_profile(environment: Mapping[str, str] = os.environ) -> str:
    """The profile file of Fast DDS that the user has set, or ''."""
    for variable in PROFILE_VARIABLES:
        if environment.get(variable):
            return environment[variable]
    # Fast DDS reads a file of this name from the working directory by itself.
    local = Path('DEFAULT_FASTRTPS_PROFILES.xml')
    return str(local) if local.exists() else ''


def profile_variable(environment: Mapping[str, str] = os.environ) -> str:
    """The variable that names Fast DDS's profile file, in the ROS that is sourced or installed."""
    if environment.get('ROS_DISTRO'):
        return PROFILE_VARIABLES[environment['ROS_DISTRO'] not in _OF_FAST_DDS_2]
    try:
        release = version('ros-rclpy')
    except PackageNotFoundError:
        return PROFILE_VARIABLES[0]
    return PROFILE_VARIABLES[int(release.partition('.')[0]) >= _RCLPY_OF_FAST_DDS_3]


def uses_fast_dds(environment: Mapping[str, str] = os.environ) -> bool:
    """Whether the middleware is Fast DDS."""
    return environment.get('RMW_IMPLEMENTATION', '') in _OWN_MIDDLEWARE


def profile_environment(
    profile: Path, image_bytes: int, environment: Mapping[str, str] = os.environ
) -> dict[str, str]:
    """What to add to the environment of nodes that hand such images to other processes.

    Nothing where the images fit, the middleware is another, or the user has a profile.

    :param profile: config/fastdds.xml.
    :param image_bytes: of the largest image.
    """
    if image_bytes <= DEFAULT_SEGMENT or not uses_fast_dds(environment):
        return {}
    return {} if user_profile(environment) else {profile_variable(environment): str(profile)}


def free_shared_memory() -> int | None:
    """Bytes that are free for the segments of the middleware; None where that cannot be told."""
    try:
        memory = os.statvfs(SHARED_MEMORY)
    except OSError:
        return None
    return memory.f_bavail * memory.f_frsize


def network_environment(
    participants: int, environment: Mapping[str, str] = os.environ
) -> dict[str, str]:
    """What to add to the environment of nodes where shared memory is too full for their segments.

    Fast DDS maps its segments without asking whether there is room, and is killed when it writes
    there. Nothing where there is room, the middleware is another, or the user has chosen.

    :param participants: processes that will each have a segment, and as much again for its ports.
    """
    free = free_shared_memory()
    if free is None or free >= 2 * participants * DEFAULT_SEGMENT:
        return {}
    if not uses_fast_dds(environment) or TRANSPORTS_VARIABLE in environment:
        return {}
    return {TRANSPORTS_VARIABLE: 'UDPv4'}


def full_memory_notice() -> str:
    """What to tell where `network_environment` gives anything."""
    free = (free_shared_memory() or 0) / 1e6
    return (
        f'{SHARED_MEMORY} is full ({free:.1f} MB free): the nodes use the network instead, which '
        f'is slower; make room there (fastrtps_* are left by nodes that were killed)'
    )
