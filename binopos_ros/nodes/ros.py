"""Whether ROS is there, for nodes and verbs that need it. It imports nothing of it."""

from __future__ import annotations

import importlib.util

REMEDY = 'source /opt/ros/jazzy/setup.bash, or pip install "binopos_ros[ros]"'


class RosMissingError(RuntimeError):
    """ROS's packages are not there for this Python."""


def require_ros() -> None:
    """See that ROS's packages can be found.

    Raises:
        RosMissingError: they cannot.
    """
    for name in ('rclpy', 'sensor_msgs'):
        if not is_installed(name):
            msg = f'{name} is not there for this Python: {REMEDY}'
            raise RosMissingError(msg)


def is_installed(name: str) -> bool:
    """Whether a package can be found, without importing it."""
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        return False
