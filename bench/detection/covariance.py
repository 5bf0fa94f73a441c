"""Whether the centre's covariance tells its errors.

    python bench/detection/covariance.py [SCENES]

Rendered discs of random size (8 to 120 px), tilt, blur, noise and colours, each as a raw picture,
a JPEG of quality 70 to 95, YUYV and a colour mosaic. NSE is the mean normalised squared error: 2
is right, more is told too well.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import numpy as np

import rendered
from binopos_ros.detection import Detector, JpegImage, RawImage
from figures import Column, Figures

RANGES = ((8, 12), (12, 20), (20, 40), (40, 121))
Row = tuple[float, float, float, float, float]


def mosaic(picture: np.ndarray) -> np.ndarray:
    """The cells of bayer_rggb8."""
    cells = picture[..., 1].copy()
    cells[::2, ::2] = picture[::2, ::2, 2]
    cells[1::2, 1::2] = picture[1::2, 1::2, 0]
    return cells


def main() -> int:
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 600
    rng = np.random.default_rng(5)
    rows: dict[str, list[Row]] = {}
    for k in range(scenes):
        low, high = RANGES[k % len(RANGES)]
        diameter = rng.uniform(low, min(high, 120))
        size = int(diameter * 1.3 + 56) // 2 * 2
        view = rendered.View(width=size, height=size, offset=tuple(rng.uniform(-150, 150, 2)))
        place = tuple((size - 1) / 2 + rng.uniform(-6, 6, 2))
        tilt, azimuth = np.radians(rng.uniform(0, 70)), rng.uniform(0, 2 * np.pi)
        disc = rendered.disc_of(view, diameter, tilt, azimuth, place)
        samples = int(np.clip(320 / diameter, 5, 12))
        scene = rendered.scene(view, disc, rng.uniform(0.4, 1.5), samples=samples)
        grey, red = rng.uniform(70, 170), rng.uniform(110, 220)
        ground = tuple(np.array([1.1, 1.0, 0.8]) * grey * rng.uniform(0.9, 1.1, 3))
        colour = (red * rng.uniform(0.15, 0.4), red * rng.uniform(0.15, 0.4), red)
        noise, quality = rng.uniform(1, 6), int(rng.uniform(70, 96))
        for floor, texture in (('even', 0.0), ('mottled', 5.0)):
            look = rendered.Look(noise=noise, ground=ground, disc=colour, texture=texture)
            picture = rendered.picture(scene, look, rng)
            images = {
                'raw': RawImage(picture.tobytes(), size, size, 3 * size, 'bgr8'),
                'JPEG': JpegImage(rendered.jpeg(picture, quality)),
                'YUYV': RawImage(rendered.yuyv(picture).tobytes(), size, size, 2 * size, 'yuyv'),
                'mosaic': RawImage(mosaic(picture).tobytes(), size, size, size, 'bayer_rggb8'),
            }
            for kind, image in images.items():
                target = Detector().detect(image).target
                if target is None:
                    continue
                error = target.centre - scene.outline_centre
                squared = float(error @ np.linalg.solve(target.covariance, error))
                told = float(np.trace(target.covariance))
                rows.setdefault(f'{kind}, {floor}', []).append((diameter, *error, told, squared))
    kept = Figures('detection/covariance', scenes=scenes)
    table = kept.table(
        'discs',
        'image, ground',
        Column('diameter, px'),
        Column('discs', '.0f'),
        Column('bias, px', '.3f'),
        Column('RMS, px', '.3f'),
        Column('told, px', '.3f'),
        Column('NSE', '.2f'),
    )
    for name, found in rows.items():
        for low, high in RANGES:
            some = np.array([row for row in found if low <= row[0] < high])
            bias, rms = np.abs(some[:, 1:3].mean(0)).max(), np.sqrt((some[:, 1:3] ** 2).mean())
            told = np.sqrt(some[:, 3].mean() / 2)
            square = some[:, 4].mean()
            table.row(name, f'{low} to {min(high, 120)}', len(some), bias, rms, told, square)
    kept.keep()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
