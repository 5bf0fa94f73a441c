"""Message definitions: from a type's name to its text, its hash and its (de)serialiser.

Our own messages come from the ROS 2 Jazzy definitions that `rosbags` carries, so no ROS is needed.
A bag's messages are read by the definitions that the bag itself holds, because a bag may come from
another distribution, or hold types that nobody here has installed.
"""

from __future__ import annotations

import os
import re
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from binopos_ros.bag.errors import BagError

#: Package and name of a message type.
TYPE_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')
_SEPARATOR = '=' * 80


class Definition(NamedTuple):
    """Text of a message type as a bag stores it."""

    encoding: str  #: 'ros2msg' or 'ros2idl'
    text: str
    type_hash: str  #: REP-2016 hash ('RIHS01_...'), or '' where unknown


@lru_cache(maxsize=1)
def jazzy() -> Any:
    """`rosbags`' typestore of ROS 2 Jazzy, made once (0.1 s)."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def full_name(type_name: str) -> str:
    """`package/Name` and `package/msg/Name` both as `package/msg/Name`."""
    package, _, name = type_name.partition('/')
    return type_name if '/' in name or not name else f'{package}/msg/{name}'


@lru_cache(maxsize=256)
def definition_of(type_name: str) -> Definition:
    """The Jazzy definition of a message type.

    Raises:
        BagError: the type is no part of ROS 2 Jazzy's common interfaces.
    """
    store = jazzy()
    if type_name not in store.types:
        message = f"message type '{type_name}' is unknown: give its definition with the topic"
        raise BagError(message)
    text, _ = store.generate_msgdef(type_name, ros_version=2)
    return Definition('ros2msg', text.rstrip('\n'), store.hash_rihs01(type_name))


def store_for(type_name: str, definition: Definition) -> Any:
    """A typestore that reads `type_name` as its definition says; Jazzy's where that is empty.

    Raises:
        BagError: the definition cannot be parsed.
    """
    store = jazzy()
    ours = ('', definition_of(type_name).text) if type_name in store.types else ()
    if definition.text.rstrip('\n') in ours:
        return store
    from rosbags.typesys import (
        Stores,
        get_types_from_idl,
        get_types_from_msg,
        get_typestore,
    )

    own = get_typestore(Stores.EMPTY)
    try:
        if definition.encoding == 'ros2idl':
            for text in re.split(rf'^{_SEPARATOR}\nIDL: .*\n', definition.text, flags=re.M):
                if text.strip():
                    own.register(get_types_from_idl(text))
        else:
            own.register(get_types_from_msg(definition.text, type_name))
    except Exception as error:
        # The parser is a third party's and raises what its grammar happens to hit.
        message = f"definition of '{type_name}' cannot be parsed: {_one_line(error)}"
        raise BagError(message) from error
    if type_name not in own.types:
        message = f"definition of '{type_name}' does not define it"
        raise BagError(message)
    return own


def _one_line(error: BaseException) -> str:
    # The parser quotes the whole definition; its beginning is enough to find it.
    words = ' '.join(str(error).split()) or type(error).__name__
    return words if len(words) <= 100 else f'{words[:100]} ...'


def installed_definition(type_name: str, type_hash: str = '') -> Definition:
    """The definition of a type out of the `.msg` files of the sourced ROS environment.

    Raises:
        BagError: a file is missing.
    """
    texts: dict[str, str] = {}
    waiting = [type_name]
    while waiting:
        name = waiting.pop(0)
        if name not in texts:
            texts[name] = _installed_text(name)
            waiting += _field_types(name, texts[name])
    first, *others = texts.items()
    parts = [first[1]] + [
        f'{_SEPARATOR}\nMSG: {name.replace("/msg/", "/")}\n{text}' for name, text in others
    ]
    return Definition('ros2msg', '\n'.join(part.rstrip('\n') for part in parts), type_hash)


def ament_prefixes() -> list[Path]:
    """Where packages of ROS are installed, overlays first; with wheels, Python's own prefix."""
    sourced = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    return [Path(prefix) for prefix in (*sourced, sys.prefix) if prefix]


def _installed_text(type_name: str) -> str:
    named = TYPE_NAME.fullmatch(type_name)
    for prefix in ament_prefixes() if named else ():
        assert named is not None
        path = prefix / 'share' / named[1] / 'msg' / f'{named[2]}.msg'
        if path.is_file():
            return path.read_text(encoding='utf-8')
    message = f"no definition of '{type_name}' is installed: source the workspace that has it"
    raise BagError(message)


def _field_types(owner: str, text: str) -> list[str]:
    """Message types of the fields in a `.msg` text."""
    package = owner.partition('/')[0]
    types: list[str] = []
    for line in text.splitlines():
        words = line.split('#', 1)[0].split()
        base = re.sub(r'(\[.*\]|<=\d+)$', '', words[0]) if len(words) > 1 else ''
        base = re.sub(r'<=\d+$', '', base)
        if '/' in base:
            types.append(full_name(base))
        elif base[:1].isupper():
            types.append(f'{package}/msg/{base}')
    return types
