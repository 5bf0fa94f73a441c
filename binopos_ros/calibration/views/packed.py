"""Pictures that come in something else: both views in one, frames of a video, an archive."""

from __future__ import annotations

import tarfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.pictures import PicturePair, Pictures, decoded, read_picture
from binopos_ros.calibration.views.sources import SUFFIXES, match_named, pictures_in

SIDE_BY_SIDE, TOP_BOTTOM = LAYOUTS = ('side-by-side', 'top-bottom')
VIDEOS = ('.avi', '.mp4', '.mkv', '.mov', '.m4v', '.mpg', '.mpeg', '.webm')
ARCHIVES = ('.tar.gz', '.tgz', '.tar', '.tar.bz2', '.tar.xz')
#: Bytes of an archive's pictures that are kept in memory.
LARGEST_ARCHIVE = 2 << 30
USUAL_RATE = 30.0  # 1/s, of a video that does not say


def is_video(source: Path) -> bool:
    """Tell by its name whether a file is a video."""
    return source.suffix.lower() in VIDEOS


def is_archive(source: Path) -> bool:
    """Tell by its name whether a file is an archive."""
    return source.name.lower().endswith(ARCHIVES)


def open_archive(source: Path) -> Pictures:
    """Pairs out of the archive that ROS's calibrator saves: left-0000.png, right-0000.png, ...

    Raises:
        CalibrationError: it cannot be read, is too large, or holds no pairs.
    """
    contents: dict[Path, bytes] = {}
    total = 0
    try:
        with tarfile.open(source) as archive:
            for member in archive:
                path = Path(member.name)
                hidden = path.name.startswith('.')
                if not member.isfile() or hidden or path.suffix.lower() not in SUFFIXES:
                    continue
                total += member.size
                if total > LARGEST_ARCHIVE:
                    raise CalibrationError(f'{source} is too large: unpack it, give the folder')
                stored = archive.extractfile(member)
                contents[path] = stored.read() if stored is not None else b''
    except (tarfile.TarError, OSError, EOFError) as error:
        raise CalibrationError(f'{source} cannot be unpacked: {error}') from None

    def load(path: Path) -> np.ndarray:
        return decoded(np.frombuffer(contents[path], np.uint8), f'{source}: {path}')

    return match_named(sorted(contents), str(source), load)


def open_halves(folder: Path, layout: str) -> Pictures:
    """Pairs out of pictures that show both views each.

    Args:
        folder: of the pictures.
        layout: one of `LAYOUTS`; the left camera's view is the left one, or the upper one.

    Raises:
        CalibrationError: there are no pictures.
    """
    return Pictures(
        tuple(
            _halved(path.name, partial(read_picture, path), layout) for path in pictures_in(folder)
        )
    )


def open_video(source: Path, interval: float, layout: str | None) -> Pictures:
    """Pairs out of a video whose frames show both views.

    Args:
        source: the video.
        interval: between the frames that are taken, s.
        layout: one of `LAYOUTS`.

    Raises:
        CalibrationError: it cannot be read, or no layout is given.
    """
    if layout is None:
        raise CalibrationError(
            f'{source} is a video: say how its frames show both views, with --layout side-by-side '
            'or top-bottom'
        )
    video = cv2.VideoCapture(str(source))
    count, rate = int(video.get(cv2.CAP_PROP_FRAME_COUNT)), video.get(cv2.CAP_PROP_FPS)
    video.release()
    if count < 1:
        raise CalibrationError(f'{source} is no video that can be read')
    step = max(1, round(interval * (rate if rate > 0.0 else USUAL_RATE)))
    return Pictures(
        tuple(
            _halved(f'frame {number}', partial(_frame, source, number), layout)
            for number in range(0, count, step)
        )
    )


def _frame(source: Path, number: int) -> np.ndarray:
    video = cv2.VideoCapture(str(source))
    video.set(cv2.CAP_PROP_POS_FRAMES, number)
    good, picture = video.read()
    video.release()
    if not good:
        raise CalibrationError(f'frame {number} of {source} cannot be read')
    return picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


def _halved(name: str, load: Callable[[], np.ndarray], layout: str) -> PicturePair:
    def half(second: bool) -> np.ndarray:
        picture = load()
        axis = 0 if layout == TOP_BOTTOM else 1
        size = picture.shape[axis]
        if size % 2:
            raise CalibrationError(f'{name} is {size} px along: two views of one size are not')
        return np.ascontiguousarray(np.split(picture, 2, axis)[second])

    return PicturePair(name, partial(half, False), partial(half, True))
