"""Interfaces that end in air, from rendered boards: plates, slabs, tanks and dry windows.

python bench/calibration/dry.py [--sets 3] [--views 15]

Pictures are those of the simulator, whose rays and lenses are its own; the cameras are known.
Each set is calibrated with the layers alone known, and with a ruler and a level beside them. A
normal can be seen where its stated deviation is below half of the tenth of a degree wanted.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
import numpy as np

from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import find_board
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import FlatInterface, StereoRig
from binopos_ros.optics.rig_state import RigState
from binopos_ros.simulation.presets import Choices, in_air, washbowl, with_board
from binopos_ros.simulation.render import Renderer
from figures import Column, Figures

BOARD = Board('chessboard', 9, 6, 0.025)
WANTED = np.radians(0.1)
#: Media and layers (m), the camera's first.
KINDS: dict[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    'plate': ((1.0, 1.49, 1.0), (0.012,)),
    'slab': ((1.0, 1.333, 1.0), (0.256,)),
    'tank': ((1.0, 1.49, 1.333, 1.49, 1.0), (0.01, 0.2, 0.01)),
    'dry window': ((1.333, 1.49, 1.0), (0.01,)),
}
DISTANCE = 0.2  # m
RULER, LEVEL = 0.001, np.radians(0.5)


class Outcome(NamedTuple):
    """Of one set: error and stated deviation of the normal (rad), views dropped, RMS (px)."""

    error: float
    deviation: float
    dropped: int
    rms: float


def rendered(kind: str, seed: int, count: int) -> tuple[StereoRig, list[View]]:
    """A rig, and the boards that are found in its pictures."""
    rng = np.random.default_rng(seed)
    indices, thicknesses = KINDS[kind]
    scene = in_air(washbowl(Choices(seed=seed)), seed)
    normal = [*(rng.normal(size=2) * np.radians(4.0)), 1.0]
    media = FlatInterface(normal, DISTANCE, indices, thicknesses)
    bare = scene.rig
    rig = StereoRig(bare.left, bare.right, bare.rotation, bare.translation, media)
    scene = with_board(replace(scene, rig=rig), BOARD, count, seed)
    times = scene.times(count)
    found = []
    for side in (0, 1):
        renderer = Renderer(scene, side)
        pictures = (renderer.picture(float(time), rng) for time in times)
        found.append([find_board(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY), BOARD) for p in pictures])
    pairs = [BoardPair(f'{i}', *both) for i, both in enumerate(zip(*found, strict=True))]
    return rig, [pair.view(BOARD) for pair in pairs if pair.complete]


def calibrated(rig: StereoRig, views: list[View], measured: bool, seed: int) -> Outcome:
    """The interface from the boards, with hand measurements or without."""
    media = rig.interface
    assert media is not None
    guess = InterfaceGuess('interface', media.indices, media.thicknesses)
    if measured:
        rng = np.random.default_rng([seed, 1])
        deviations = {'distance': RULER, 'normal': LEVEL}
        distance = media.distance + RULER * rng.normal()
        x, y, z = media.tilted(*(LEVEL * rng.normal(size=2)))
        guess = replace(guess, distance=distance, normal=(x, y, z), deviations=deviations)
    air = replace(RigState.of(rig), interfaces={})
    result = calibrate_interface(air, views, [guess])
    assert result.adjustment is not None
    found = result.state.interfaces['interface'].axis
    error = float(np.arccos(min(1.0, float(found @ media.normal))))
    spread = max(result.deviation(f'interface.normal.{i}') for i in (0, 1))
    return Outcome(error, spread, len(result.dropped), result.adjustment.rms())


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--sets', type=int, default=3)
    parser.add_argument('--views', type=int, default=15)
    arguments = parser.parse_args()
    print(f'{arguments.sets} sets of {arguments.views} rendered pairs, boards of 25 mm squares')
    kept = Figures('calibration/dry', sets=arguments.sets, views=arguments.views)
    table = kept.table(
        'kinds',
        '',
        Column('measured'),
        Column('views', '.0f'),
        Column('dropped', '.0f'),
        Column('RMS (px)', '.3f'),
        Column('normal, worst (deg)', '.3f'),
        Column('stated (deg)', '.3f'),
        Column('seen'),
        Column('worst error / stated', '.2f'),
    )
    for kind in KINDS:
        sets = [rendered(kind, seed, arguments.views) for seed in range(arguments.sets)]
        count = sum(len(views) for _, views in sets)
        for measured in (False, True):
            found = [
                calibrated(rig, views, measured, seed) for seed, (rig, views) in enumerate(sets)
            ]
            errors, spreads = (np.array([one[i] for one in found]) for i in (0, 1))
            table.row(
                kind,
                'ruler, level' if measured else '-',
                count,
                sum(one.dropped for one in found),
                max(one.rms for one in found),
                np.degrees(errors.max()),
                np.degrees(spreads.max()),
                'yes' if (spreads < WANTED / 2.0).all() else 'no',
                (errors / spreads).max(),
            )
    kept.keep()


if __name__ == '__main__':
    main()
