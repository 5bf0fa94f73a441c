"""Where the pictures come from: folders, and lists of them. All give pairs of grey pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.lists import listed
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.calibration.views.pictures import PicturePair, Pictures, read_picture
from binopos_ros.sides import SIDES

SUFFIXES = ('.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp')


class _Naming(NamedTuple):
    """A way in which names tell the sides: patterns, the surest first, and the left one's end."""

    patterns: tuple[re.Pattern[str], ...]
    left: str


WORDS = _Naming(
    (
        re.compile(r'(?<![a-z])(left|right)(?![a-z])', re.IGNORECASE),
        re.compile(r'(left|right)', re.IGNORECASE),
    ),
    'left',
)
#: As kalibr and EuRoC name cameras.
NUMBERS = _Naming((re.compile(r'(?<![a-z])(cam(?:era)?[_-]?0?[01])(?!\d)', re.IGNORECASE),), '0')
LETTERS = _Naming((re.compile(r'(?<![a-z])([lr])(?![a-z])', re.IGNORECASE),), 'l')
#: As KITTI names its folders; pictures are numbered like that.
IMAGES = _Naming((re.compile(r'^(image_0?[01])$', re.IGNORECASE),), '0')
#: Where a camera's folder keeps its pictures, as EuRoC's do.
INNER = 'data'


def open_files(source: Path) -> Pictures:
    """Pairs from a folder of pictures or a list of them.

    Args:
        source: a folder with pictures whose names tell the sides (left and right, cam0 and cam1,
            L and R), or with a sub-folder for each side; or a list, see `lists.listed`.

    Raises:
        CalibrationError: nothing there, or nothing that makes pairs.
    """
    if not source.is_dir():
        files = listed(source)
        pairs = zip(files[::2], files[1::2], strict=True)
        return Pictures(tuple(_pair(a, b, read_picture) for a, b in pairs))
    inside = sorted(path for path in source.iterdir() if path.is_dir())
    for naming in (WORDS, NUMBERS, LETTERS, IMAGES):
        folders = _by_side(inside, naming)
        if all(len(folders[side]) == 1 for side in SIDES):
            return folder_pair(*(folders[side][0] for side in SIDES))
    return match_named(_pictures_in(source), str(source))


def match_named(
    pictures: Sequence[Path], where: str, load: Callable[[Path], np.ndarray] = read_picture
) -> Pictures:
    """Pairs of pictures whose names tell the side.

    Raises:
        CalibrationError: they do not, or make no pairs.
    """
    for naming in (WORDS, NUMBERS, LETTERS):
        sides = _by_side(pictures, naming)
        if all(sides.values()):
            return match(sides['left'], sides['right'], where, naming, load)
    sides = _by_side(pictures, WORDS)
    if pictures and not any(sides.values()):
        raise CalibrationError(
            f'{where}: the names of its {len(pictures)} pictures tell no side: name them '
            'left01.jpg and right01.jpg; where both views lie in one picture, add --layout '
            'side-by-side or top-bottom'
        )
    return match(sides['left'], sides['right'], where)


def match(
    left: Sequence[Path],
    right: Sequence[Path],
    where: str = '',
    naming: _Naming = WORDS,
    load: Callable[[Path], np.ndarray] = read_picture,
) -> Pictures:
    """Pair files whose names agree but for what tells the side."""
    if not left or not right:
        missing = 'left' if not left else 'right'
        raise CalibrationError(
            f'no {missing} pictures in {where or "the folders given"}: name them left01.jpg, '
            'right01.jpg and so on, or put them into sub-folders left and right'
        )
    unmatched: list[Dropped] = []
    keys = [_keyed(paths, naming, unmatched) for paths in (left, right)]
    common = sorted(keys[0].keys() & keys[1].keys(), key=_natural)
    if not common and len(left) == len(right):
        pairs = zip(*(sorted(paths, key=_natural_name) for paths in (left, right)), strict=True)
        return Pictures(tuple(_pair(a, b, load) for a, b in pairs))
    unmatched += [
        Dropped(path.name, f'it has no {other} partner of the same number')
        for own, theirs, other in ((keys[0], keys[1], 'right'), (keys[1], keys[0], 'left'))
        for key, path in own.items()
        if key not in theirs
    ]
    if not common:
        raise CalibrationError(
            f'{len(left)} left and {len(right)} right pictures, but no two names agree: number '
            'the pictures of a pair alike'
        )
    return Pictures(
        tuple(_pair(keys[0][key], keys[1][key], load) for key in common), tuple(unmatched)
    )


def folder_pair(left: Path, right: Path) -> Pictures:
    """Pairs from one folder per camera."""
    for folder in (left, right):
        if not folder.is_dir():
            raise CalibrationError(f'{folder} is no folder of pictures')
    return match(_pictures_in(left), _pictures_in(right), f'{left} and {right}')


def pictures_in(folder: Path) -> list[Path]:
    """The pictures of a folder by their names; hidden files, as macOS leaves, are none.

    Raises:
        CalibrationError: there is none.
    """
    found = sorted(_pictures_in(folder), key=_natural_name)
    if not found:
        raise CalibrationError(f'{folder} holds no pictures')
    return found


def _pictures_in(folder: Path) -> list[Path]:
    found = [
        path
        for path in sorted(folder.iterdir())
        if path.suffix.lower() in SUFFIXES and not path.name.startswith('.')
    ]
    inner = folder / INNER
    return _pictures_in(inner) if not found and inner.is_dir() else found


def _by_side(paths: Iterable[Path], naming: _Naming) -> dict[str, list[Path]]:
    """Files or folders by the side that their names tell; those that tell none are left out."""
    sides: dict[str, list[Path]] = {side: [] for side in SIDES}
    for path in paths:
        found = next(filter(None, (each.search(path.stem) for each in naming.patterns)), None)
        if found:
            sides[SIDES[not found[1].lower().endswith(naming.left)]].append(path)
    return sides


def _keyed(paths: Sequence[Path], naming: _Naming, collided: list[Dropped]) -> dict[str, Path]:
    """Files by what their partners' names have in common with theirs; the first of a name."""
    found: dict[str, Path] = {}
    for path in paths:
        key = _key(path, naming)
        if key in found:
            told = f'{found[key].name} has the same number: leave one of them'
            collided.append(Dropped(path.name, told))
        else:
            found[key] = path
    return found


def _key(path: Path, naming: _Naming) -> str:
    for pattern in naming.patterns:
        rest, count = pattern.subn('', path.stem)
        if count:
            return rest.lower()
    return path.stem.lower()


def _natural_name(path: Path) -> list[tuple[int, str]]:
    return _natural(path.name)


def _natural(key: str) -> list[tuple[int, str]]:
    # Only decimal digits: int() refuses others that isdigit() takes.
    return [
        (int(part), '') if part.isdecimal() else (-1, part) for part in re.split(r'(\d+)', key)
    ]


def _pair(left: Path, right: Path, load: Callable[[Path], np.ndarray]) -> PicturePair:
    return PicturePair(f'{left.name}|{right.name}', partial(load, left), partial(load, right))
