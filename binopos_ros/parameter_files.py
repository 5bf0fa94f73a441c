"""ROS 2 parameter files and `--ros-args`, read by ROS's rules, without ROS, for nodes and verbs.

A block holds for every node whose full name its key matches: `/**` stands for any number of
levels, `/*` for one. Later blocks win over earlier ones, later files and words over earlier ones.
Numbers, words and lists are read as ROS reads them; what ROS has not (aliases) is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from binopos_ros.parameters import ParameterError

PARAMETERS = 'ros__parameters'
WILDCARDS = {'**': r'(/\w+)*', '*': r'/\w+'}
#: Bytes and levels that no parameter file reaches.
LARGEST_FILE = 1 << 20
DEEPEST_BLOCK = 20
_TRUE = {'true', 'True', 'TRUE', 'yes', 'Yes', 'YES', 'on', 'On', 'ON', 'y', 'Y'}
_FALSE = {'false', 'False', 'FALSE', 'no', 'No', 'NO', 'off', 'Off', 'OFF', 'n', 'N'}
_INTEGER = re.compile(r'[-+]?(0[xX][0-9a-fA-F]{1,15}|\d{1,18})')
_FLOAT = re.compile(r'[-+]?(\d+\.?\d*([eE][-+]?\d+)?|\.\d+([eE][-+]?\d+)?|\.(inf|Inf|INF))')
_NAN = {'.nan', '.NaN', '.NAN'}


@dataclass(frozen=True)
class Entry:
    """A parameter's value, and where it was given: `FILE:LINE`, or the word.

    `folder` is that of the file, where there is one.
    """

    value: Any
    place: str
    folder: Path | None = None


@dataclass(frozen=True)
class Block:
    """Parameters of the nodes that a key names; `typed` where it stood on the command line."""

    key: str
    entries: dict[str, Entry]
    place: str
    typed: bool = False

    @property
    def node(self) -> str:
        """The name of the node, or a wildcard."""
        return self.key.rpartition('/')[2]

    def matches(self, full_name: str) -> bool:
        """Whether it holds for a node, by ROS's rules."""
        levels = self.key.strip('/').split('/')
        pattern = ''.join(WILDCARDS.get(level, f'/{re.escape(level)}') for level in levels)
        return re.fullmatch(pattern, full_name) is not None

    @property
    def is_wild(self) -> bool:
        """Whether it names no node, but all of some places."""
        return self.node in WILDCARDS


def read_blocks(path: Path) -> list[Block]:
    """The blocks of a parameter file.

    Raises:
        ParameterError: it cannot be read, or is no parameter file.
    """
    try:
        with path.open('rb') as stream:
            data = stream.read(LARGEST_FILE + 1)
        text = data.decode('utf-8')
    except OSError as error:
        msg = f'{path}: cannot be read: {error.strerror}'
        raise ParameterError(msg) from error
    except UnicodeDecodeError as error:
        msg = f'{path}: is no YAML file: {error.reason}'
        raise ParameterError(msg) from error
    if len(data) > LARGEST_FILE:
        msg = f'{path}: is larger than {LARGEST_FILE >> 20} MiB: no parameter file is'
        raise ParameterError(msg)
    root = _compose(text, str(path))
    if root is None:
        return []
    if not isinstance(root, yaml.MappingNode):
        msg = f'{path}:1: must begin with a node name such as /**/triangulator:'
        raise ParameterError(msg)
    return list(_blocks(str(path), '', root))


def assigned_block(word: str) -> Block:
    """The block of a word `[NODE:]NAME:=VALUE` after `-p`; NODE alone holds in any namespace.

    Raises:
        ParameterError: it is no assignment.
    """
    target, separator, text = word.partition(':=')
    node, colon, name = target.rpartition(':')
    if not separator or not name:
        msg = f'--ros-args -p {word}: write -p NODE:NAME:=VALUE'
        raise ParameterError(msg)
    place = f'-p {word}'
    key = '/**' if not colon else node if node.startswith('/') else f'/**/{node.strip("/")}'
    value = _compose(text, place)
    entries = {name: Entry('', place)} if value is None else dict(_entries(place, name, value))
    return Block(key, entries, place, typed=True)


@dataclass(frozen=True)
class RosArguments:
    """The words after `--ros-args`: blocks of parameters, and what else is there."""

    blocks: list[Block]
    files: list[Path]
    assignments: list[str]
    others: list[str]

    @classmethod
    def of(cls, words: Sequence[str]) -> RosArguments:
        """Part the words.

        Raises:
            ParameterError: a file or an assignment cannot be read.
        """
        found = cls([], [], [], [])
        remaining = iter(word for word in words if word != '--ros-args')
        for word in remaining:
            if word == '--params-file':
                found.files.append(Path(next(remaining, '')))
                found.blocks.extend(read_blocks(found.files[-1]))
            elif word in ('-p', '--param'):
                found.assignments.append(next(remaining, ''))
                found.blocks.append(assigned_block(found.assignments[-1]))
            else:
                found.others.append(word)
        return found

    def full_name(self, name: str, namespace: str) -> str:
        """A node's full name, after the rules `-r [NODE:]__ns:=` and `__node:=`."""
        rules = [
            word
            for before, word in zip(self.others, self.others[1:], strict=False)
            if before in ('-r', '--remap')
        ]
        for rule in rules:
            source, _, target = rule.partition(':=')
            node, _, what = source.rpartition(':')
            if node not in ('', name):
                continue
            if what == '__ns':
                namespace = target
                break
        for rule in rules:
            source, _, target = rule.partition(':=')
            node, _, what = source.rpartition(':')
            if node in ('', name) and what in ('__node', '__name'):
                name = target
                break
        return f'/{namespace.strip("/")}/{name}'.replace('//', '/')


def _compose(text: str, place: str) -> yaml.Node | None:
    """The YAML nodes of a text; without aliases, and not deeper than any parameter file is."""
    try:
        depth = 0
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if isinstance(event, yaml.AliasEvent):
                msg = f'{_at(place, event)}: *{event.anchor}: parameter files have no aliases'
                raise ParameterError(msg)
            if depth > DEEPEST_BLOCK:
                msg = f'{_at(place, event)}: more than {DEEPEST_BLOCK} levels deep'
                raise ParameterError(msg)
        return yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        told = getattr(error, 'problem', None) or ' '.join(str(error).split())
        mark = getattr(error, 'problem_mark', None)
        where = f'{place}:{mark.line + 1}' if mark is not None else place
        msg = f'{where}: is no YAML: {told}'
        raise ParameterError(msg) from error


def _at(place: str, node: yaml.Node | yaml.Event) -> str:
    """`FILE:LINE`; an assignment has but one line."""
    return place if place.startswith('-p ') else f'{place}:{node.start_mark.line + 1}'


def _folder(place: str) -> Path | None:
    return None if place.startswith('-p ') else Path(place).parent


def _blocks(place: str, prefix: str, node: yaml.MappingNode) -> Iterator[Block]:
    for key, value in node.value:
        where = _at(place, key)
        if key.value == PARAMETERS:
            if not isinstance(value, yaml.MappingNode):
                msg = f'{where}: {PARAMETERS} of {prefix or "/"} must hold names and values'
                raise ParameterError(msg)
            entries = dict(_flat(place, '', value))
            yield Block(prefix, entries, _at(place, node))
        elif isinstance(value, yaml.MappingNode):
            yield from _blocks(place, f'{prefix}/{str(key.value).strip("/")}', value)
        else:
            msg = f'{where}: {prefix}/{str(key.value).strip("/")} has no {PARAMETERS} block'
            raise ParameterError(msg)


def _flat(place: str, prefix: str, node: yaml.MappingNode) -> Iterator[tuple[str, Entry]]:
    for key, value in node.value:
        yield from _entries(place, f'{prefix}{key.value}', value)


def _entries(place: str, name: str, node: yaml.Node) -> Iterator[tuple[str, Entry]]:
    if isinstance(node, yaml.MappingNode):
        yield from _flat(place, f'{name}.', node)
        return
    where = _at(place, node)
    if isinstance(node, yaml.SequenceNode):
        if any(not isinstance(item, yaml.ScalarNode) for item in node.value):
            msg = f'{where}: {name} is a list of lists: give single values'
            raise ParameterError(msg)
        yield name, Entry([_scalar(item) for item in node.value], where, _folder(place))
        return
    yield name, Entry(_scalar(node), where, _folder(place))


def _scalar(node: yaml.Node) -> Any:
    """A value as ROS's parser reads it; unlike YAML 1.1 it takes 1e-6 for a number."""
    text = str(node.value)
    if getattr(node, 'style', None) in ('"', "'", '|', '>') or node.tag.endswith(':binary'):
        return text
    if text in ('', '~', 'null'):
        return None
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    if _INTEGER.fullmatch(text):
        return int(text, 16) if 'x' in text.lower() else int(text)
    if _FLOAT.fullmatch(text):
        return float(text.lower().replace('.inf', 'inf'))
    return float('nan') if text in _NAN else text
