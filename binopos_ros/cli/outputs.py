"""What a verb writes takes its place when it is whole: nothing half made, nothing lost."""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class OutputError(ValueError):
    """An output that cannot be made."""


@contextmanager
def written(path: Path, force: bool) -> Iterator[Path]:
    """A path to write to, a file or a folder, that becomes `path` when all went well.

    It lies in a hidden folder beside `path` and bears its name. Where something goes wrong it is
    removed, and what was at `path` stays.

    Args:
        path: the output.
        force: replace what is there.

    Raises:
        OutputError: there is something already, or it cannot be written there.
    """
    if not force and (path.exists() or path.is_symlink()):
        msg = f'{path} exists already: choose another name, or replace it with --force'
        raise OutputError(msg)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix=f'.{path.name}.', dir=path.parent))
    except OSError as error:
        msg = f'{path}: cannot be written: {error.strerror}'
        raise OutputError(msg) from error
    try:
        part = folder / path.name
        yield part
        if path.is_dir() and not path.is_symlink():
            os.replace(path, folder / f'{path.name}.old')
        os.replace(part, path)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def add_force_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--force`, for verbs that write files."""
    parser.add_argument('--force', action='store_true', help='replace outputs that exist')
