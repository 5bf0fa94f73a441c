"""How much the answers on real pictures hang on each threshold.

Run as `python bench/detection/thresholds.py`.

Runs the detector over the real pictures of red buoys with one option changed at a time.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

from binopos_ros.detection import Detector, Frame, JpegImage, decode
from figures import Column, Figures

DATA = Path(__file__).resolve().parents[3] / 'shared' / 'data' / 'robosub-red-buoy'
CLEAR, OPEN = (100, 200, 300, 400, 900, 1000), (0, 500, 600, 700, 1100, 1400)
CHANGES: tuple[dict[str, float], ...] = (
    {},
    *({'min_contrast': value} for value in (0.09, 0.15)),
    *({'min_redness': value} for value in (-0.2, -0.15, -0.08, -0.05, 0.0)),
    *({'min_fit': value} for value in (0.75, 0.85)),
    {'min_axis_ratio': 0.3},
    *({'max_yellow': value} for value in (0.8, 1.0)),
    *({'max_blue': value} for value in (0.2, 0.3)),
    *({'min_seen': value} for value in (0.3, 0.6)),
    {'min_diameter': 9.0},
    *({'noise_factor': value} for value in (4.0, 9.0)),
    {'mirror_above': False},
)

Picture = tuple[int, Frame, tuple[int, ...]]


def pictures() -> list[Picture]:
    with (DATA / 'index.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    return [
        (
            int(row['image']) // 100 * 100,
            decode(JpegImage((DATA / 'Images' / f'{row["image"]}.jpg').read_bytes())),
            tuple(int(row[key]) for key in ('xmin', 'ymin', 'xmax', 'ymax') if row[key]),
        )
        for row in rows
    ]


def counted(every: list[Picture], groups: tuple[int, ...], detector: Detector) -> list[int]:
    """Pictures, boxes, hits and wrong targets of some groups."""
    counts = [0, 0, 0, 0]
    for group, frame, box in every:
        if group not in groups:
            continue
        target = detector.detect_in(frame).target
        hit = False
        if target is not None and box:
            u, v = target.centre
            hit = bool(box[0] <= u <= box[2] and box[1] <= v <= box[3])
        for k, each in enumerate((True, bool(box), hit, target is not None and not hit)):
            counts[k] += each
    return counts


def main() -> int:
    if not DATA.is_dir():
        print(f'{DATA.name} is not there: the real pictures are not in this checkout')
        return 0
    every = pictures()
    kept = Figures('detection/thresholds')
    titles = 'clear: boxes', 'hits', 'wrong', 'open: pictures', 'hits', 'wrong'
    table = kept.table('options', 'option', *(Column(title, '.0f') for title in titles))
    for change in CHANGES:
        detector = Detector(track=False, **change)
        clear, open_water = (counted(every, groups, detector) for groups in (CLEAR, OPEN))
        name = ', '.join(f'{key} = {value}' for key, value in change.items()) or 'as they are'
        table.row(name, *clear[1:], open_water[0], *open_water[2:])
    kept.keep()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
