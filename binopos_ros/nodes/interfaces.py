"""Message types by name.

Names come out of bags and off the network, so nothing is imported that they name: a class comes
from an installed interface package or not at all. Which those are, the ament index says.
"""

from __future__ import annotations

import importlib
import importlib.util
from pathlib import Path

from binopos_ros.bag import TopicInfo
from binopos_ros.bag.definitions import TYPE_NAME, ament_prefixes

INDEX = Path('share', 'ament_index', 'resource_index', 'rosidl_interfaces')


def installed_class(type_name: str) -> type | None:
    """The class of a message type `package/msg/Name`, None where it is not installed."""
    named = TYPE_NAME.fullmatch(type_name)
    if named is None:
        return None
    package, name = named.groups()
    if not any(_holds(prefix, package, name) for prefix in ament_prefixes()):
        return None
    try:
        found = getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None
    return found if isinstance(found, type) else None


def _holds(prefix: Path, package: str, name: str) -> bool:
    """Whether a prefix has the message type, and Python would import the package from there."""
    index = prefix / INDEX / package
    if not index.is_file() or f'msg/{name}.msg' not in index.read_text('utf-8').split():
        return False
    # Of a package at the top level this imports nothing.
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return False
    return Path(spec.origin).absolute().is_relative_to(prefix.absolute())


def playable_class(info: TopicInfo) -> tuple[type | None, str]:
    """The installed class of a recorded topic's type, or None and why it cannot be played."""
    if info.encoding != 'cdr':
        return None, f"its messages are encoded as '{info.encoding}', not as 'cdr'"
    found = installed_class(info.type)
    return found, '' if found else f'message type {info.type} is not installed'
