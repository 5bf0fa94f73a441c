"""Which files a bag consists of: a folder with or without metadata.yaml, or a single file."""

from __future__ import annotations

import logging
import re
from pathlib import Path, PurePath
from typing import Any

from binopos_ros import plain_yaml
from binopos_ros.bag.errors import BagError

METADATA = 'metadata.yaml'
_SUFFIXES = ('.mcap', '.mcap.zstd', '.db3', '.db3.zstd', '.bag')

#: A bag's files in their order.
Files = tuple[Path, ...]

_log = logging.getLogger('binopos.bag')


def find_files(path: Path) -> Files:
    """Files of the bag at `path`.

    Raises:
        BagError: nothing there, or nothing that is a bag.
    """
    if path.name == METADATA and path.is_file():
        path = path.parent
    if path.is_file():
        return (path,)
    if not path.is_dir():
        message = (
            f'{path}: no such bag: give a folder written by `ros2 bag record`, or a .mcap file'
        )
        raise BagError(message)
    files = _listed_files(path, _read_metadata(path))
    return files or _unlisted_files(path)


def _read_metadata(folder: Path) -> dict[str, Any]:
    path = folder / METADATA
    if not path.is_file():
        return {}
    try:
        content = plain_yaml.load(path.read_text(encoding='utf-8'))
        information = content['rosbag2_bagfile_information']
        if isinstance(information, dict):
            return information
        reason = 'no rosbag2_bagfile_information'
    except (OSError, UnicodeDecodeError, TypeError, KeyError):
        reason = 'no rosbag2_bagfile_information'
    except plain_yaml.PlainYamlError as error:
        reason = str(error)
    _log.warning('%s: unreadable (%s); the bag is read without it', path, reason)
    return {}


def _listed_files(folder: Path, metadata: dict[str, Any]) -> Files:
    listed = metadata.get('relative_file_paths')
    files: list[Path] = []
    for name in listed if isinstance(listed, list) else []:
        found = _listed_file(folder, str(name))
        if found is None:
            _log.warning(
                '%s: %s is listed in %s but missing; its part of the bag is left out',
                folder,
                name,
                METADATA,
            )
        else:
            files.append(found)
    others = [file for file in folder.iterdir() if is_bag_file(file) and file not in files]
    if files and others:
        _log.warning(
            '%s: %s lists %d of %d files; the other %d are left out, %s among them: remove %s '
            'to read them all',
            folder,
            METADATA,
            len(files),
            len(files) + len(others),
            len(others),
            min(others, key=_natural).name,
            METADATA,
        )
    return tuple(files)


def _listed_file(folder: Path, listed: str) -> Path | None:
    """A file that the metadata name, in the bag's folder and nowhere else."""
    # Early versions of rosbag2 wrote the folder's name before the file's.
    names = [listed, PurePath(listed).name]
    for name in [*names, *(f'{name}.zstd' for name in names)]:
        inside = not PurePath(name).is_absolute() and '..' not in PurePath(name).parts
        if inside and '\0' not in name and (folder / name).is_file():
            return folder / name
    return None


def _unlisted_files(folder: Path) -> Files:
    files = sorted((file for file in folder.iterdir() if is_bag_file(file)), key=_natural)
    if not files:
        message = f'{folder}: holds no .mcap file: give the folder that `ros2 bag record` wrote'
        raise BagError(message)
    kinds = {file.name.partition('.')[2] for file in files}
    if len(kinds) > 1 and any(kind.startswith('mcap') for kind in kinds):
        files = [file for file in files if file.name.partition('.')[2].startswith('mcap')]
    return tuple(files)


def is_bag_file(path: Path) -> bool:
    """Whether a file's name is that of a bag, or of a part of one."""
    return path.name.endswith(_SUFFIXES)


def _natural(path: Path) -> list[str | int]:
    return [int(part) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)]
