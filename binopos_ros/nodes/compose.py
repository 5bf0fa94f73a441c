"""Several nodes in one process, by name."""

from __future__ import annotations

import importlib
import json
import os
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
    'viewer': 'ViewerNode',
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


def compose_later() -> int:
    """Import all nodes, wait for the words of `compose` on standard input, and run them.

    The words come as one line of JSON; at the end of input there is nothing to run.
    """
    for name in NODES:
        try:
            node_class(name)
        except ImportError:
            # Of a node that this machine cannot run; whoever asks for it is told then.
            continue
    line = sys.stdin.readline()
    if not line:
        return 0
    os.dup2(os.open(os.devnull, os.O_RDONLY), sys.stdin.fileno())
    return compose(json.loads(line))
