"""Where the pictures come from: folders, lists, messages. All give pairs of grey pictures."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.pairs import Dropped
from binopos_ros.detection.images import JpegImage, RawImage, decode
from binopos_ros.sides import SIDES

SUFFIXES = ('.jpg', '.jpeg', '.png', '.bmp', '.tif', '.tiff', '.pgm', '.ppm', '.webp')
SIDE = re.compile(r'(?<![a-z])(left|right)(?![a-z])', re.IGNORECASE)
MONO = ('mono8', '8UC1')
DEEP_MONO = ('mono16', '16UC1')

Load = Callable[[], np.ndarray]


@dataclass(frozen=True)
class PicturePair:
    """A pair of pictures, loaded when called: (H, W) uint8."""

    name: str
    left: Load
    right: Load


@dataclass(frozen=True)
class Pictures:
    """pairs: in order; unmatched: pictures without a partner, with the reason."""

    pairs: tuple[PicturePair, ...]
    unmatched: tuple[Dropped, ...] = ()


def open_files(source: Path) -> Pictures:
    """Pairs from a folder of pictures or a list of them.

    Args:
        source: a folder with left* and right* files or with sub-folders left and right; a text
            file with two paths per line; an OpenCV XML image list, left and right by turns.

    Raises:
        CalibrationError: nothing there, or nothing that makes pairs.
    """
    if source.is_dir():
        folders = [source / side for side in SIDES]
        if all(folder.is_dir() for folder in folders):
            return match(_pictures_in(folders[0]), _pictures_in(folders[1]))
        sides: dict[str, list[Path]] = {'left': [], 'right': []}
        for path in _pictures_in(source):
            named = SIDE.search(path.stem) or re.search(r'(left|right)', path.stem, re.IGNORECASE)
            if named:
                sides[named[1].lower()].append(path)
        return match(sides['left'], sides['right'], str(source))
    return _from_list(source)


def match(left: Sequence[Path], right: Sequence[Path], where: str = '') -> Pictures:
    """Pair files whose names agree but for the words left and right."""
    if not left or not right:
        missing = 'left' if not left else 'right'
        raise CalibrationError(
            f'no {missing} pictures in {where or "the folders given"}: name them left01.jpg, '
            'right01.jpg and so on, or put them into sub-folders left and right'
        )
    keys = [{_key(path): path for path in paths} for paths in (left, right)]
    common = sorted(keys[0].keys() & keys[1].keys(), key=_natural)
    if not common and len(left) == len(right):
        pairs = list(zip(sorted(left), sorted(right), strict=True))
        return Pictures(tuple(_file_pair(*pair) for pair in pairs))
    unmatched = [
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
        tuple(_file_pair(keys[0][key], keys[1][key]) for key in common), tuple(unmatched)
    )


def folder_pair(left: Path, right: Path) -> Pictures:
    """Pairs from one folder per camera."""
    for folder in (left, right):
        if not folder.is_dir():
            raise CalibrationError(f'{folder} is no folder of pictures')
    return match(_pictures_in(left), _pictures_in(right), f'{left} and {right}')


def _pictures_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)


def _key(path: Path) -> str:
    return re.sub(r'left|right', '', path.stem, flags=re.IGNORECASE).lower()


def _natural(key: str) -> list[tuple[int, str]]:
    return [(int(part), '') if part.isdigit() else (-1, part) for part in re.split(r'(\d+)', key)]


def _file_pair(left: Path, right: Path) -> PicturePair:
    return PicturePair(f'{left.name}|{right.name}', lambda: _read(left), lambda: _read(right))


def _read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise CalibrationError(f'{path} is missing or no picture that can be read')
    return np.asarray(image)


def _from_list(path: Path) -> Pictures:
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError):
        raise CalibrationError(
            f'{path} is neither a folder, a bag nor a list of pictures'
        ) from None
    names: list[str] = []
    if '<imagelist>' in text:
        names = re.findall(r'"([^"]+)"', text.split('<imagelist>')[1])
    else:
        for number, line in enumerate(text.splitlines(), 1):
            words = line.replace(',', ' ').split()
            if not words or words[0].startswith('#'):
                continue
            if len(words) != 2:
                raise CalibrationError(
                    f'{path}, line {number}: write the left and the right picture of a pair'
                )
            names += words
    if len(names) < 2 or len(names) % 2:
        raise CalibrationError(f'{path} lists {len(names)} pictures: pairs are needed')
    files = [path.parent / name for name in names]
    return Pictures(tuple(_file_pair(a, b) for a, b in zip(files[::2], files[1::2], strict=True)))


def grey_picture(image: JpegImage | RawImage, stamp: int) -> np.ndarray:
    """(H, W) uint8 of a camera's image, of that stamp (ns).

    Raises:
        CalibrationError: the picture is damaged.
    """
    if isinstance(image, JpegImage):
        data = np.frombuffer(image.data, np.uint8)
        grey = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
        if grey is None:
            raise CalibrationError(f'the picture at {stamp / 1e9:.3f} is damaged: leave it out')
        return np.asarray(grey)
    if image.encoding in (*MONO, *DEEP_MONO):
        rows = np.frombuffer(image.data, np.uint8)
        if rows.size < image.height * image.step:
            raise CalibrationError(f'the picture at {stamp / 1e9:.3f} is cut short: leave it out')
        rows = rows[: image.height * image.step].reshape(image.height, image.step)
        if image.encoding in DEEP_MONO:
            # The upper of the two bytes.
            rows = rows[:, 0 if image.big_endian else 1 :: 2]
        return np.ascontiguousarray(rows[:, : image.width])
    frame = decode(image)
    return cv2.cvtColor(frame.window(0, 0, frame.width, frame.height), cv2.COLOR_BGR2GRAY)
