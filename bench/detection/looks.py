"""Balls and discs as cameras see them: RMS and covariance beside a plain script, look by look.

    python bench/detection/looks.py [PICTURES] [LOOK ...]

Every cell holds so many pictures (30 unless told) of one look, encoding and size. It gives the
detector's RMS per coordinate and the plain script's, px, and the mean normalised squared error,
which is 2 where the covariance is right. A cell is marked `!` where that lies outside of 1.4 to
2.8 or the RMS is above the script's, and told how many targets were missed.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import cv2
import numpy as np

import looks
import rendered
from binopos_ros.detection import Detector, JpegImage, RawImage, decode
from figures import Column, Figures

SIZES = (14, 20, 40, 80)
ENCODINGS = ('bgr8', 'JPEG 95', 'JPEG 80', 'JPEG 50', 'yuyv', 'bayer_rggb8')


def encoded(picture: np.ndarray, encoding: str) -> JpegImage | RawImage:
    """A picture as a camera sends it; JPEG is of 4:2:0."""
    height, width = picture.shape[:2]
    if encoding.startswith('JPEG'):
        return JpegImage(rendered.jpeg(picture, int(encoding.split()[1])))
    if encoding == 'yuyv':
        return RawImage(rendered.yuyv(picture).tobytes(), width, height, 2 * width, encoding)
    if encoding == 'bgr8':
        return RawImage(picture.tobytes(), width, height, 3 * width, encoding)
    cells = picture[..., 1].copy()
    cells[::2, ::2] = picture[::2, ::2, 2]
    cells[1::2, 1::2] = picture[1::2, 1::2, 0]
    return RawImage(cells.tobytes(), width, height, width, encoding)


def pictures(look: looks.Look, size: int, count: int) -> list[looks.Taken]:
    """The pictures of one look and size, the same in every encoding."""
    rng = np.random.default_rng(size)
    return [looks.take(look, size * rng.uniform(0.9, 1.1), rng) for _ in range(count)]


def cell(every: list[looks.Taken], encoding: str) -> tuple[str, bool]:
    """One cell in words, and whether it keeps to its goals."""
    count = len(every)
    errors, plain, squared = [], [], []
    for taken in every:
        image = encoded(taken.picture, encoding)
        frame = decode(image)
        script = looks.plain_script(frame.window(0, 0, frame.width, frame.height))
        if script is not None:
            plain.append(script - taken.centre)
        target = Detector().detect(image).target
        if target is None:
            continue
        error = target.centre - taken.centre
        errors.append(error)
        squared.append(error @ np.linalg.solve(target.covariance, error))
    if not errors:
        return f'all {count} missed', False
    rms = np.sqrt(np.mean(np.square(errors)))
    beside = np.sqrt(np.mean(np.square(plain))) if plain else np.inf
    nse = np.mean(squared)
    good = 1.4 <= nse <= 2.8 and rms <= beside
    missed = f' ({count - len(errors)} missed)' if len(errors) < count else ''
    return f'{rms:.3f}, {beside:.3f}; {nse:.2f}{"" if good else " !"}{missed}', good


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    every = {**looks.LOOKS, **looks.HIDDEN}
    chosen = sys.argv[2:] or list(every)
    cv2.setNumThreads(1)
    kept = cells = 0
    figures = Figures('detection/looks', pictures=count)
    sizes = (Column(f'{size} px') for size in SIZES)
    table = figures.table('looks', 'look', Column('encoding'), *sizes)
    for name in chosen:
        taken = [pictures(every[name], size, count) for size in SIZES]
        for encoding in ENCODINGS:
            row = [cell(each, encoding) for each in taken]
            kept, cells = kept + sum(good for _, good in row), cells + len(row)
            table.row(name, encoding, *(words for words, _ in row))
    print(f'{kept} of {cells} cells keep to their goals')
    if not sys.argv[2:]:
        figures.keep()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
