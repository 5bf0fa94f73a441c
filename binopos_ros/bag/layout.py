"""Which files a bag consists of: a folder with or without metadata.yaml, or a single file."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from binopos_ros.bag.errors import BagError

METADATA = 'metadata.yaml'
_SUFFIXES = ('.mcap', '.mcap.zstd')

_log = logging.getLogger('binopos.bag')


@dataclass(frozen=True)
class Layout:
    """A bag's files in their order, and whether each message in them is compressed by itself."""

    files: tuple[Path, ...]
    zstd_messages: bool = False


def find_layout(path: Path) -> Layout:
    """Files of the bag at `path`.

    Raises:
        BagError: nothing there, or nothing that is a bag in MCAP format.
    """
    if path.name == METADATA and path.is_file():
        path = path.parent
    if path.is_file():
        if path.suffix == '.db3':
            raise BagError(_sqlite(path))
        return Layout((path,))
    if not path.is_dir():
        message = (
            f'{path}: no such bag: give a folder written by `ros2 bag record`, or a .mcap file'
        )
        raise BagError(message)
    metadata = _read_metadata(path)
    if metadata is not None:
        if metadata.get('storage_identifier') == 'sqlite3':
            raise BagError(_sqlite(path))
        files = _listed_files(path, metadata)
        if files:
            mode = str(metadata.get('compression_mode') or '').lower()
            return Layout(files, zstd_messages=mode == 'message')
    return Layout(_unlisted_files(path))


def _read_metadata(folder: Path) -> dict[str, Any] | None:
    path = folder / METADATA
    if not path.is_file():
        return None
    import yaml

    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
        information = content['rosbag2_bagfile_information']
        if isinstance(information, dict):
            return information
    except (yaml.YAMLError, UnicodeDecodeError, TypeError, KeyError):
        pass
    _log.warning('%s: unreadable; the bag is read without it', path)
    return None


def _listed_files(folder: Path, metadata: dict[str, Any]) -> tuple[Path, ...]:
    files: list[Path] = []
    for listed in metadata.get('relative_file_paths') or []:
        # Early versions of rosbag2 wrote the folder's name before the file's.
        candidates = [folder / str(listed), folder / Path(str(listed)).name]
        candidates += [Path(f'{candidate}.zstd') for candidate in candidates]
        found = next((candidate for candidate in candidates if candidate.is_file()), None)
        if found is None:
            _log.warning(
                '%s: %s is listed in %s but missing; its part of the bag is left out',
                folder,
                listed,
                METADATA,
            )
        else:
            files.append(found)
    return tuple(files)


def _unlisted_files(folder: Path) -> tuple[Path, ...]:
    files = sorted(
        (file for file in folder.iterdir() if file.name.endswith(_SUFFIXES)), key=_natural
    )
    if not files:
        if any(folder.glob('*.db3')):
            raise BagError(_sqlite(folder))
        message = f'{folder}: holds no .mcap file: give the folder that `ros2 bag record` wrote'
        raise BagError(message)
    return tuple(files)


def _natural(path: Path) -> list[str | int]:
    return [int(part) if part.isdigit() else part for part in re.split(r'(\d+)', path.name)]


def _sqlite(path: Path) -> str:
    return f'{path}: a bag in sqlite3 format: convert it to MCAP with `ros2 bag convert`'
