"""Whether images fit the middleware's shared memory, and the profile for those that do not."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

DEFAULT_SEGMENT = 512 * 1024
PROFILE_SEGMENT = 64 * 1024 * 1024
"""Bytes of the segment that Fast DDS takes by itself, and by config/fastdds.xml."""

PROFILE_VARIABLES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
_OWN_MIDDLEWARE = ('', 'rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp')


def user_profile(environment: Mapping[str, str] = os.environ) -> str:
    """The profile file of Fast DDS that the user has set, or ''."""
    for variable in PROFILE_VARIABLES:
        if environment.get(variable):
            return environment[variable]
    # Fast DDS reads a file of this name from the working directory by itself.
    local = Path('DEFAULT_FASTRTPS_PROFILES.xml')
    return str(local) if local.exists() else ''


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
    return {} if user_profile(environment) else {PROFILE_VARIABLES[0]: str(profile)}
