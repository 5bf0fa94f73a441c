"""The nodes' executables: what `ros2 run binopos_ros NODE` starts.

ROS loads slowly, so a signal must already be heeded before it is imported: nothing else may be
imported at the top.
"""

from __future__ import annotations

import sys

from binopos_ros.nodes.ros import RosMissingError, require_ros
from binopos_ros.nodes.supervised import prepare

USAGE_ERROR = 2


def camera() -> int:
    """Run the camera node until a signal; the exit status."""
    return start('camera')


def detector() -> int:
    """Run the detector node until a signal; the exit status."""
    return start('detector')


def triangulator() -> int:
    """Run the triangulator node until a signal; the exit status."""
    return start('triangulator')


def smoother() -> int:
    """Run the smoother node until a signal; the exit status."""
    return start('smoother')


def player() -> int:
    """Run the player node until a signal or the end of its bag; the exit status."""
    return start('player')


def viewer() -> int:
    """Run the viewer node until a signal; the exit status."""
    return start('viewer')


def recorder() -> int:
    """Run the recorder node until a signal; the exit status."""
    if not prepared('recorder'):
        return USAGE_ERROR
    from binopos_ros.nodes.recorder import record

    return record(sys.argv[1:])


def start(name: str) -> int:
    """Run one node with the command line's ROS arguments; the exit status."""
    if not prepared(name):
        return USAGE_ERROR
    from binopos_ros.nodes.compose import compose  # signals first: rclpy loads slowly

    return compose([name, *sys.argv[1:]])


def prepared(name: str) -> bool:
    """Heed signals; whether ROS is there, which is told in a line where it is not."""
    prepare()
    try:
        require_ros()
    except RosMissingError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return False
    return True
