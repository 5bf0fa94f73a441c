"""Is the lens model right? Rigs of narrow lenses of five terms and of wide equidistant ones.

python bench/calibration/lenses.py                     3 rigs of each kind; a minute
python bench/calibration/lenses.py --rigs 50           what docs/calibration.md has; half an hour
python bench/calibration/lenses.py --results FILE      go on where an earlier run has ended

The lens is right where it is Brown's for a Brown lens and another for a wide one, every good pair
is kept, every pixel has a ray, and held-out errors are within 1.1 of the corners' noise.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np

from binopos_ros.calibration.cameras.lens import blind_share
from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.optics import PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import exponential
from figures import Column, Figures

BOARD = Board('chessboard', 11, 8, 0.1)
SIZE = (1280, 640)
PAIRS, NOISE = 20, 0.15  # px
#: Focal length (px) and terms: a Brown lens, and r = theta to a hundred-thousandth, 113 degrees.
KINDS = {
    'brown': (700.0, [-0.3, 0.12, 0.0005, -0.0003, -0.02]),
    'wide': (420.0, [0.992, 0.2041, 0.0003, -0.0002, 0.0046, 1.3253, 0.4459, 0.0307]),
}
BASELINE = 0.07  # m


def see(kind: str, rng: np.random.Generator) -> list[BoardPair]:
    """What a rig of that kind sees of boards anywhere in its left picture."""
    focal, terms = KINDS[kind]
    cameras = []
    for _ in range(2):
        f, centre = focal * rng.uniform(0.97, 1.03), rng.uniform([632, 312], [648, 328])
        matrix = [[f, 0.0, centre[0]], [0.0, f, centre[1]], [0.0, 0.0, 1.0]]
        cameras.append(PinholeCamera(matrix, terms, SIZE))
    rotation = exponential(rng.uniform(-0.01, 0.01, 3))
    rig = StereoRig(cameras[0], cameras[1], rotation, -rotation @ [BASELINE, 0.0, 0.0])
    points = BOARD.points - BOARD.points.mean(axis=0)
    pairs: list[BoardPair] = []
    while len(pairs) < PAIRS:
        turned = exponential(rng.uniform([-0.6, -0.6, -0.3], [0.6, 0.6, 0.3]))
        ray = cameras[0].unproject(rng.uniform([0, 0], SIZE))
        seen = rig.project(points @ turned.T + rng.uniform(0.7, 2.0) * ray)
        if all(np.isfinite(p).all() and (p > 0).all() and (p < [1279, 639]).all() for p in seen):
            noisy = [p + rng.normal(scale=NOISE, size=p.shape) for p in seen]
            views = [BoardView(np.arange(len(points)), p, 2.0) for p in noisy]
            pairs.append(BoardPair(f'{len(pairs)}', *views))
    return pairs


def judge(kind: str, seed: int) -> dict[str, float]:
    """Calibrate one rig: whether both lenses are of its kind, and what it shows for it."""
    pairs = see(kind, np.random.default_rng(300 + seed))
    result = calibrate_stereo(pairs, BOARD, (SIZE, SIZE))
    five = [len(camera.lens) == 5 for camera in result.state.cameras]
    return {
        'right': all(five) if kind == 'brown' else not any(five),
        'dropped': len(result.dropped),
        'blind': max(blind_share(camera) for camera in result.state.cameras),
        'held_out': result.held_out.rms / (np.sqrt(2.0) * NOISE),
    }


def keep(kept: Figures, found: dict[str, dict[str, float]], rigs: int) -> None:
    """Print and keep a row for each kind of lens."""
    table = kept.table(
        'lenses',
        'lens',
        Column('right'),
        Column('pairs dropped', '.0f'),
        Column('pixels without a ray, %', '.1f'),
        Column('held out / noise, worst', '.3f'),
    )
    for kind in KINDS:
        own = [found[f'{kind} {seed}'] for seed in range(rigs)]
        right, dropped = (sum(one[key] for one in own) for key in ('right', 'dropped'))
        blind, worst = (max(one[key] for one in own) for key in ('blind', 'held_out'))
        table.row(kind, f'{right:g} of {rigs}', dropped, 100 * blind, worst)
    kept.keep()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rigs', type=int, default=3)
    parser.add_argument('--results', type=Path, help='keeps the rigs that were done')
    arguments = parser.parse_args()
    figures = Figures('calibration/lenses', rigs=arguments.rigs)
    kept: Path | None = arguments.results
    found: dict[str, dict[str, float]] = {}
    if kept is not None and kept.exists():
        found = dict(json.loads(line) for line in kept.read_text(encoding='utf-8').splitlines())
    # By turns, so that what an interrupted run has done is of both kinds.
    for seed in range(arguments.rigs):
        for kind in KINDS:
            name = f'{kind} {seed}'
            if name in found:
                continue
            found[name] = judge(kind, seed)
            if kept is not None:
                with kept.open('a', encoding='utf-8') as file:
                    file.write(json.dumps([name, found[name]]) + '\n')
    keep(figures, found, arguments.rigs)


if __name__ == '__main__':
    main()
