"""The oST text format, version 5.0: sections in brackets, titles in them, numbers under these."""

from __future__ import annotations

import os

from binopos_ros.optics.camera_info import CameraInfo, lens_model
from binopos_ros.optics.camera_info_fields import finite, whole
from binopos_ros.optics.errors import OpticsError

PathLike = str | os.PathLike[str]


def is_ost(text: str) -> bool:
    """Tell whether a file begins like oST text."""
    first = next((line.strip() for line in text.splitlines() if line.strip()), '')
    return first.startswith(('# oST', '['))


def cameras_of_ost(text: str, path: PathLike) -> list[CameraInfo]:
    """The cameras in an oST file, in its order, named as its sections are.

    Raises:
        OpticsError: there is none, or one is incomplete.
    """
    infos: list[CameraInfo] = []
    size: dict[str, tuple[float, ...]] = {}
    for section, titled in _sections(text):
        numbers = {title: finite(words, title, None, path) for title, words in titled.items()}
        if section == 'image':
            size = numbers
        else:
            infos.append(_camera(section, size, numbers, path))
    if not infos:
        msg = f'{path} is no calibration: it holds no camera'
        raise OpticsError(msg)
    return infos


def _sections(text: str) -> list[tuple[str, dict[str, list[str]]]]:
    """Return the sections in order: their names, and the words under each of their titles."""
    found: list[tuple[str, dict[str, list[str]]]] = []
    words: list[str] = []
    for raw in text.splitlines():
        line = raw.strip()
        if not line or line.startswith('#'):
            continue
        if line.startswith('[') and line.endswith(']'):
            found.append((line[1:-1].strip(), {}))
        elif found and line[0].isalpha():
            words = found[-1][1].setdefault(line, [])
        elif found and found[-1][1]:
            words += line.split()
    return found


def _camera(
    name: str,
    size: dict[str, tuple[float, ...]],
    numbers: dict[str, tuple[float, ...]],
    path: PathLike,
) -> CameraInfo:
    wanted = {'camera matrix': 9, 'distortion': None, 'rectification': 9, 'projection': 12}
    for key, count in wanted.items():
        found = len(numbers.get(key, ()))
        if not found or (count is not None and found != count):
            msg = (
                f'{path}: [{name[:80]}] needs {count or "some"} numbers under {key!r}, not {found}'
            )
            raise OpticsError(msg)
    first = {key: next(iter(values), 0.0) for key, values in size.items()}
    return CameraInfo(
        name=name,
        width=whole(first, 'width', path, 0),
        height=whole(first, 'height', path, 0),
        distortion_model=lens_model('', len(numbers['distortion'])),
        d=numbers['distortion'],
        k=numbers['camera matrix'],
        r=numbers['rectification'],
        p=numbers['projection'],
    )
