"""ROS parameter files and `--ros-args`, read without ROS for the offline verbs."""

from __future__ import annotations

import argparse
import fnmatch
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from binopos_ros.parameters import ParameterError

NAMESPACE = '/stereo'
STAGES = ('detector', 'triangulator', 'smoother')
BAG_CONFIG = 'binopos.yaml'


def add_config_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--config FILE`, which every verb takes."""
    parser.add_argument(
        '--config',
        type=Path,
        metavar='FILE',
        help='ROS 2 parameter file of the nodes; verbs that read a bag take its binopos.yaml',
    )


def existing(config: Path) -> Path:
    """The parameter file that was given.

    Raises:
        ParameterError: it does not exist.
    """
    if not config.is_file():
        msg = f'{config}: there is no such parameter file; check the path after --config'
        raise ParameterError(msg)
    return config


def config_of_bag(config: Path | None, bag: Path) -> Path | None:
    """The parameter file to use: the one given, else the one that lies in the bag's folder.

    Raises:
        ParameterError: the file that was given does not exist.
    """
    if config is not None:
        return existing(config)
    own = (bag if bag.is_dir() else bag.parent) / BAG_CONFIG
    return own if own.is_file() else None


class Parameters:
    """Parameter values by node, from a parameter file and from `--ros-args`.

    Args:
        config: a ROS 2 parameter file, or None.
        ros_arguments: the words after `--ros-args`: `-p [NODE:]NAME:=VALUE` and
            `--params-file FILE`.

    Raises:
        ParameterError: a file or a word cannot be read.
    """

    def __init__(self, config: Path | None, ros_arguments: Sequence[str] = ()) -> None:
        self._blocks: list[tuple[str, dict[str, Any]]] = []
        if config is not None:
            self._read(config)
        words = iter(ros_arguments)
        for word in words:
            if word == '--params-file':
                self._read(Path(next(words, '')))
            elif word in ('-p', '--param'):
                self._assign(next(words, ''))
            else:
                msg = f'--ros-args {word}: only -p NODE:NAME:=VALUE and --params-file work offline'
                raise ParameterError(msg)

    def by_node(self) -> dict[str, dict[str, Any]]:
        """Parameter values of the stages' nodes, by node."""
        return {name: self.of_node(name) for name in STAGES}

    def of_node(self, name: str) -> dict[str, Any]:
        """Parameter values of a node in the namespace /stereo; later blocks win."""
        full_name = f'{NAMESPACE}/{name}'
        values: dict[str, Any] = {}
        for pattern, block in self._blocks:
            if _matches(pattern, full_name):
                values.update(block)
        # Offline there is no clock to choose and no transport to tune.
        return {
            key: value
            for key, value in values.items()
            if key != 'use_sim_time' and not key.startswith('qos_overrides.')
        }

    def _read(self, path: Path) -> None:
        try:
            content = yaml.safe_load(path.read_text(encoding='utf-8')) or {}
        except OSError as error:
            msg = f'{path}: cannot be read: {error.strerror}'
            raise ParameterError(msg) from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            msg = f'{path}: is no YAML file: {" ".join(str(error).split())}'
            raise ParameterError(msg) from error
        if not isinstance(content, dict):
            msg = f'{path}: must begin with a node name such as /**/triangulator:'
            raise ParameterError(msg)
        self._collect(path, '', content)

    def _collect(self, path: Path, prefix: str, content: dict[str, Any]) -> None:
        for key, value in content.items():
            if key == 'ros__parameters':
                if not isinstance(value, dict):
                    msg = f'{path}: ros__parameters of {prefix or "/"} must hold names and values'
                    raise ParameterError(msg)
                self._blocks.append((prefix, _flatten(value)))
            elif isinstance(value, dict):
                self._collect(path, f'{prefix}/{str(key).strip("/")}', value)
            else:
                msg = f'{path}: {prefix}/{key} has no ros__parameters block'
                raise ParameterError(msg)

    def _assign(self, word: str) -> None:
        target, separator, value = word.partition(':=')
        node, colon, name = target.rpartition(':')
        if not separator or not name:
            msg = f'--ros-args -p {word}: write -p NODE:NAME:=VALUE'
            raise ParameterError(msg)
        pattern = f'/**/{node.rsplit("/", 1)[-1]}' if colon else '/**'
        self._blocks.append((pattern, {name: yaml.safe_load(value)}))


def _matches(pattern: str, full_name: str) -> bool:
    if pattern == '/**':
        return True
    return fnmatch.fnmatchcase(full_name, pattern.replace('/**/', '*/'))


def _flatten(block: dict[str, Any], prefix: str = '') -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in block.items():
        if isinstance(value, dict):
            flat.update(_flatten(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
