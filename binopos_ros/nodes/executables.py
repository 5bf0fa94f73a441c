"""The nodes' executables: what `ros2 run binopos_ros NODE` starts.

ROS loads slowly, so a signal must already be heeded before it is imported: nothing else may be
imported at the top.
"""

from __future__ import annotations

import sys

from binopos_ros.nodes.supervised import prepare


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


def recorder() -> int:
    """Run the recorder node until a signal; the exit status."""
    prepare()
    from binopos_ros.nodes.recorder import record

    return record(sys.argv[1:])


def start(name: str) -> int:
    """Run one node with the command line's ROS arguments; the exit status."""
    prepare()
    from binopos_ros.nodes.compose import compose  # signals first: rclpy loads slowly

    return compose([name, *sys.argv[1:]])
