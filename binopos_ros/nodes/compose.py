"""Several nodes in one process, by name."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Sequence

from rclpy.node import Node

from binopos_ros.nodes.running import run

#: Node -> its class.
NODES = {
    'camera': 'CameraNode',
    'detector': 'DetectorNode',
    'triangulator': 'TriangulatorNode',
    'smoother': 'SmootherNode',
    'player': 'PlayerNode',
    'recorder': 'RecorderNode',
}


def node_class(name: str) -> Callable[..., Node]:
    """The class of a node of the suite."""
    factory: Callable[..., Node] = getattr(
        importlib.import_module(f'binopos_ros.nodes.{name}'), NODES[name]
    )
    return factory


def compose(arguments: Sequence[str]) -> int:
    """Run the nodes that are named before `--ros-args` in this process; the exit status."""
    words = list(arguments)
    split = words.index('--ros-args') if '--ros-args' in words else len(words)
    names, ros_words = words[:split], words[split:]
    unknown = [name for name in names if name not in NODES]
    if unknown or not names:
        known = ', '.join(NODES)
        print(f'binopos_ros.nodes: name nodes to run, out of {known}', file=sys.stderr)
        return 2
    return run({name: node_class(name) for name in names}, ros_words)
