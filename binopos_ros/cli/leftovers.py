"""What killed runs left on this machine: shared memory of the middleware, unpacked bags."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

SHARED_MEMORY = Path('/dev/shm')
#: Segments have hexadecimal names; ports, which are small, are taken up again by themselves.
SEGMENTS = 'fastrtps_[0-9a-f]*_el'
LOCK_SUFFIX = '_el'
UNPACKED = 'binopos_bag_*'
PROCESSES = Path('/proc')
#: Seconds that a process may need between making a thing and taking hold of it.
YOUNG = 60.0


def clear_leftovers(shared: Path = SHARED_MEMORY, temporary: Path | None = None) -> None:
    """Remove this user's leftovers that no process holds any more.

    Args:
        shared: where the middleware has its segments.
        temporary: where bags are unpacked; by default the system's folder for that.
    """
    for lock in _old(shared, SEGMENTS):
        if _is_free(lock):
            for path in (lock.with_name(lock.name.removesuffix(LOCK_SUFFIX)), lock):
                path.unlink(missing_ok=True)
    folders = list(_old(temporary or Path(tempfile.gettempdir()), UNPACKED))
    if folders:
        held = set(_open_files())
        for folder in folders:
            if folder.is_dir() and not any(path.startswith(f'{folder}/') for path in held):
                shutil.rmtree(folder, ignore_errors=True)


def _old(folder: Path, pattern: str) -> Iterator[Path]:
    """What this user has made there some time ago, links apart."""
    for path in folder.glob(pattern):
        try:
            status = path.lstat()
        except OSError:
            continue
        is_own = status.st_uid == os.getuid() and not path.is_symlink()
        if is_own and time.time() - status.st_mtime > YOUNG:
            yield path


def _is_free(lock: Path) -> bool:
    """Whether the process that holds a segment, by this lock of Fast DDS, has gone."""
    try:
        with lock.open('rb') as stream:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _open_files() -> Iterator[str]:
    """The names of all files that this user's processes have open."""
    for descriptor in PROCESSES.glob('[0-9]*/fd/*'):
        try:
            yield os.readlink(descriptor)
        except OSError:
            continue
