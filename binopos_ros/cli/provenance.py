"""How a report was made: the command, and each input with what tells it from another."""

from __future__ import annotations

import argparse
from pathlib import Path

from binopos_ros.sheet import Made


def how_made(arguments: argparse.Namespace, *inputs: Path | None) -> Made:
    """The command of the arguments, and its inputs: files and folders, None for one not given."""
    told = []
    for path in inputs:
        if path is not None:
            files = _files(path)
            total = sum(each.stat().st_size for each in files)
            many = f' in {len(files)} files' if path.is_dir() else ''
            told.append(f'{path}: {total:,} bytes{many}')
    return Made(arguments.command, told)


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return [each for each in path.rglob('*') if each.is_file()]
    return [path] if path.is_file() else []
