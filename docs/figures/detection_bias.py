"""Bias and RMS of the target's centre against its size: `python docs/figures/detection_bias.py`.

Discs under water, rendered by the tests' own renderer, tilted by 30 degrees, blur 0.8 px, noise
2 grey levels; raw, and as JPEG of quality 85. Prints the table and draws detection_bias.png.
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import matplotlib as mpl
import numpy as np

import rendered
from binopos_ros.detection import Detector, JpegImage, RawImage

mpl.use('Agg')
import matplotlib.pyplot as plt

DIAMETERS = (8, 10, 14, 20, 28, 40, 60, 85, 120)
SCENES, PICTURES = 24, 2
KINDS = (('raw', 0), ('JPEG 85', 85))


def errors(diameter: int, quality: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Errors (n, 2) of both methods, px, and the standard deviations that were told."""
    found: dict[str, list[np.ndarray]] = {'subpixel': [], 'paper': [], 'told': []}
    size = int(diameter * 1.3 + 56) // 2 * 2
    for _ in range(SCENES):
        view = rendered.View(width=size, height=size, offset=tuple(rng.uniform(-150, 150, 2)))
        place = tuple((size - 1) / 2 + rng.uniform(-6, 6, 2))
        disc = rendered.disc_of(view, diameter, np.pi / 6, rng.uniform(0, 2 * np.pi), place)
        scene = rendered.scene(view, disc, 0.8, samples=int(np.clip(400 / diameter, 5, 14)))
        for _ in range(PICTURES):
            picture = rendered.picture(scene, rendered.Look(noise=2.0), rng)
            image = (
                JpegImage(rendered.jpeg(picture, quality))
                if quality
                else RawImage(picture.tobytes(), size, size, 3 * size, 'bgr8')
            )
            for method in ('subpixel', 'paper'):
                target = Detector(method=method).detect(image).target
                if target is None:
                    continue
                found[method].append(target.centre - scene.outline_centre)
                if method == 'subpixel':
                    found['told'].append(np.sqrt(np.diag(target.covariance)))
    return {name: np.array(each).reshape(-1, 2) for name, each in found.items()}


def main() -> int:
    rng = np.random.default_rng(12)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), sharex=True)
    print(
        '  image  diameter  found     bias      RMS     told |  four extremes: found  bias    RMS'
    )
    for (kind, quality), colour in zip(KINDS, ('tab:blue', 'tab:orange'), strict=True):
        rows = []
        for diameter in DIAMETERS:
            each = errors(diameter, quality, rng)
            row = []
            for name in ('subpixel', 'paper'):
                some = each[name]
                bias = np.abs(some.mean(0)).max() if len(some) else np.nan
                rms = np.sqrt(np.mean(some**2)) if len(some) else np.nan
                row += [len(some), bias, rms]
            told = np.sqrt(np.mean(each['told'] ** 2))
            rows.append((*row, told))
            print(
                f'{kind:>8}{diameter:7} px{row[0]:7}{row[1]:9.4f}{row[2]:9.4f}{told:9.4f} |'
                f'{row[3]:21}{row[4]:7.3f}{row[5]:7.3f}'
            )
        table = np.array(rows)
        for axes, column in ((left, 1), (right, 2)):
            axes.loglog(DIAMETERS, table[:, column], 'o-', color=colour, label=f'subpixel, {kind}')
            axes.loglog(
                DIAMETERS,
                table[:, column + 3],
                's:',
                color=colour,
                alpha=0.6,
                label=f'four extremes, {kind}',
            )
        right.loglog(DIAMETERS, table[:, 6], '--', color=colour, label=f'covariance told, {kind}')
    left.axhline(0.02, color='k', lw=0.8)
    right.axhline(0.05, color='k', lw=0.8)
    left.set(ylabel='bias, px', xlabel='diameter, px')
    right.set(ylabel='RMS, px', xlabel='diameter, px')
    right.legend(fontsize=8)
    for axes in (left, right):
        axes.grid(alpha=0.3, which='both')
        axes.set_xticks([8, 20, 40, 120], ['8', '20', '40', '120'])
    figure.tight_layout()
    figure.savefig(Path(__file__).with_suffix('.png'), dpi=110)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
