"""Message types by name."""

from __future__ import annotations

import importlib


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
