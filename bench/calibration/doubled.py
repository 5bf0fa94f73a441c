"""Is refraction that is counted twice found, and nothing else taken for it? Simulated rigs.

python bench/calibration/doubled.py [--rigs 8]

Cameras are calibrated through the water by OpenCV, and the true interface is put on top. Beside
them the same rigs calibrated in air: exact, and with faults that must not be taken for it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
import numpy as np
import truth

from binopos_ros.calibration.check.doubled import Refraction, refraction
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import exponential
from binopos_ros.triangulation import triangulate
from figures import Column, Figures

PAIRS = 200
REACHES = {'anywhere': 0.3, 'in the middle': 0.12}  # of the depth, from the axis
KINDS = ('surface', 'wall', 'ports')
#: Tilt of the normals (rad), share of the distance, index, by which an interface is off.
FAULTS = ((0.0, 0.0, 0.0), (0.035, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.03))
TURN = (0.003, 0.0, 0.003)  # of the right camera since (rad)

Surfaces = dict[str, FlatInterface]


def calibrated_in_water(
    rig: StereoRig, depths: tuple[float, float], rng: np.random.Generator
) -> StereoRig:
    """What OpenCV makes of boards in the water, as if there were none."""
    views = truth.see_boards(rig, depths, rng, 8, truth.EVERYWHERE)
    boards = [view.points.astype(np.float32) for view in views]
    sides = [[view.pixels[side].astype(np.float32) for view in views] for side in (0, 1)]
    one = [cv2.calibrateCamera(boards, s, truth.SIZE, np.eye(3), np.zeros(5)) for s in sides]
    guess = cv2.CALIB_USE_INTRINSIC_GUESS
    wet = cv2.stereoCalibrate(boards, *sides, *one[0][1:3], *one[1][1:3], truth.SIZE, flags=guess)
    cameras = [PinholeCamera(wet[i], wet[i + 1].ravel(), truth.SIZE) for i in (1, 3)]
    return StereoRig(cameras[0], cameras[1], wet[5], wet[6].ravel())


def judge(air: StereoRig, surfaces: Surfaces, pixels: Sequence[np.ndarray]) -> Refraction:
    """What `calibrate check` asks."""
    rig = StereoRig(air.left, air.right, air.rotation, air.translation, **surfaces)
    bent, straight = triangulate(rig, *pixels), triangulate(air, *pixels)
    return refraction(rig, bent.points, bent.residuals, straight.points, straight.residuals)


def off(surfaces: Surfaces, tilt: float, farther: float, index: float) -> Surfaces:
    """Interfaces with errors."""
    return {
        place: FlatInterface(
            one.tilted(tilt, -tilt),
            (1.0 + farther) * one.distance,
            (*one.indices[:-1], one.indices[-1] + index),
            one.thicknesses,
        )
        for place, one in surfaces.items()
    }


def counted(kind: str, reach: float, rigs: int) -> tuple[str, float, str]:
    """Of rigs of one kind: how many are found, how many cannot be told, how many are accused."""
    found = unsure = accused = 0
    for seed in range(rigs):
        rng = np.random.default_rng(70_000 + seed)
        rig, depths = truth.make_rig(kind, rng)
        wet = calibrated_in_water(rig, depths, rng)
        dry = StereoRig(rig.left, rig.right, rig.rotation, rig.translation)
        surfaces = {
            place: one
            for place in ('interface', *truth.PORTS)
            if (one := getattr(rig, place)) is not None
        }
        middle = -(rig.rotation.T @ rig.translation)[:2] / 2.0
        depth = rng.uniform(*depths, PAIRS)
        aside = rng.uniform([-reach, -0.8 * reach], [reach, 0.8 * reach], (PAIRS, 2))
        points = np.column_stack([middle + aside * depth[:, None], depth])
        pixels = [p + rng.normal(scale=truth.NOISE, size=p.shape) for p in rig.project(points)]
        twice = judge(wet, surfaces, pixels)
        found += twice.is_twice
        unsure += not twice.is_twice and bool(twice.text)
        turn = exponential(np.array(TURN))
        turned = StereoRig(dry.left, dry.right, turn @ dry.rotation, turn @ dry.translation)
        innocent = [judge(dry, off(surfaces, *fault), pixels) for fault in FAULTS]
        innocent.append(judge(turned, surfaces, pixels))
        accused += sum(one.is_twice for one in innocent)
    return f'{found} of {rigs}', unsure, f'{accused} of {rigs * (len(FAULTS) + 1)}'


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rigs', type=int, default=8)
    rigs = parser.parse_args().rigs
    print(f'{PAIRS} pairs, {truth.NOISE} px')
    kept = Figures('calibration/doubled', rigs=rigs)
    table = kept.table(
        'rigs',
        '',
        Column('target'),
        Column('found'),
        Column('cannot be told', '.0f'),
        Column('calibrated in air, accused'),
    )
    for words, reach in REACHES.items():
        for kind in KINDS:
            table.row(kind, words, *counted(kind, reach, rigs))
    kept.keep()


if __name__ == '__main__':
    main()
