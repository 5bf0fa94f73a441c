"""Message types by name."""

from __future__ import annotations

import importlib

from binopos_ros.bag import TopicInfo


def installed_class(type_name: str) -> type | None:
    """The class of a message type `package/msg/Name`, None where it is not installed."""
    package, kind, name = [*type_name.split('/'), '', ''][:3]
    if kind != 'msg':
        return None
    try:
        found: type = getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None
    return found


def playable_class(info: TopicInfo) -> tuple[type | None, str]:
    """The installed class of a recorded topic's type, or None and why it cannot be played."""
    if info.encoding != 'cdr':
        return None, f"its messages are encoded as '{info.encoding}', not as 'cdr'"
    found = installed_class(info.type)
    return found, '' if found else f'message type {info.type} is not installed'
