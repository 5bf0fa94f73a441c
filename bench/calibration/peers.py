"""Stereo calibrations beside OpenCV's and mrcal's, on the same corners of simulated rigs.

python bench/calibration/peers.py                 2 rigs, flat boards and bowed ones; a minute
python bench/calibration/peers.py --rigs 10       what docs/calibration.md has

Errors are RMS over the rigs; stated deviations are those each program gives of itself, and the
ratio of the two is 1 where they are true. OpenCV's stereoCalibrate states none. mrcal is left out
where it is not installed (it has wheels for Python 3.12 and 3.13).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
import numpy as np

from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.optics import PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import exponential
from figures import Column, Figures

BOARD = Board('chessboard', 9, 6, 0.025)
SIZE = (1280, 960)
VIEWS, NOISE = 20, 0.1  # px
BOWS = (0.0, 0.001)  # m at the edge of the board
LENS = [-0.2, 0.08, 0.001, -0.001, 0.0]
FOCAL, BASELINE = 700.0, 0.12


@dataclass(frozen=True)
class Outcome:
    """Left focal length (px) and baseline (m), each with its stated deviation or nan."""

    focal: float
    focal_deviation: float
    baseline: float
    baseline_deviation: float


def see(rng: np.random.Generator, bow: float) -> list[BoardPair]:
    """Boards in both pictures."""
    matrix = [[FOCAL, 0.0, 640.0], [0.0, FOCAL, 480.0], [0.0, 0.0, 1.0]]
    camera = PinholeCamera(matrix, LENS, SIZE)
    rotation = exponential(np.array([0.01, 0.08, -0.005]))
    rig = StereoRig(camera, camera, rotation, -rotation @ [BASELINE, 0.0, 0.0])
    points = BOARD.points - BOARD.points.mean(axis=0)
    points[:, 2] = bow * (points[:, 0] / points[:, 0].max()) ** 2
    pairs: list[BoardPair] = []
    while len(pairs) < VIEWS:
        turned = exponential(rng.uniform([-0.7, -0.7, -0.3], [0.7, 0.7, 0.3]))
        depth = rng.uniform(0.3, 0.55)
        aside = depth * rng.uniform([-0.45, -0.45, 0.0], [0.45, 0.45, 0.0])
        seen = rig.project(points @ turned.T + aside + [0.06, 0.0, depth])
        if all((p > 0).all() and (p < [1279, 959]).all() for p in seen):
            noisy = [p + rng.normal(scale=NOISE, size=p.shape) for p in seen]
            views = [BoardView(np.arange(len(points)), p, 2.0) for p in noisy]
            pairs.append(BoardPair(f'{len(pairs)}', *views))
    return pairs


def ours(pairs: list[BoardPair]) -> Outcome:
    """`binopos calibrate stereo`."""
    fit = calibrate_stereo(pairs, BOARD, (SIZE, SIZE)).adjustment
    shift = fit.state.translation
    length = float(np.linalg.norm(shift))
    own = [fit.state.names.index(f'translation.{axis}') for axis in 'xyz']
    spread = shift / length @ fit.covariance[np.ix_(own, own)] @ shift / length
    focal = float(fit.state.cameras[0].focal[0])
    return Outcome(focal, fit.deviation('left.fx'), length, float(np.sqrt(spread)))


def opencv(pairs: list[BoardPair]) -> Outcome:
    """calibrateCameraExtended for each camera, then stereoCalibrate of everything."""
    points = [BOARD.points.astype(np.float32)] * len(pairs)
    sides = [
        [np.asarray(getattr(pair, side).pixels, np.float32) for pair in pairs]
        for side in ('left', 'right')
    ]
    single = [
        cv2.calibrateCameraExtended(points, side, SIZE, np.eye(3), np.zeros(5)) for side in sides
    ]
    found = cv2.stereoCalibrate(
        points,
        *sides,
        *single[0][1:3],
        *single[1][1:3],
        SIZE,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-8),
    )
    stated = float(single[0][5][0, 0])
    return Outcome(float(found[1][0, 0]), stated, float(np.linalg.norm(found[6])), np.nan)


def with_mrcal(pairs: list[BoardPair]) -> Outcome:
    """mrcal.optimize of lens, geometry and the board's deformation; J'J inverted for the rest."""
    import mrcal

    columns, rows = BOARD.shape
    count = len(pairs)
    seen = np.ones((2 * count, rows, columns, 3))
    indices = np.zeros((2 * count, 3), np.int32)
    for i, pair in enumerate(pairs):
        for side, view in enumerate(pair.sides):
            assert view is not None
            seen[2 * i + side, :, :, :2] = view.pixels.reshape(rows, columns, 2)
            indices[2 * i + side] = i, side, side - 1
    lens = 'LENSMODEL_OPENCV5'
    sizes = np.array([SIZE, SIZE], np.int32)
    start = np.tile([FOCAL, FOCAL, 639.5, 479.5], (2, 1)).astype(float)
    seed = mrcal.seed_stereographic(
        imagersizes=sizes,
        focal_estimate=np.array([FOCAL, FOCAL]),
        indices_frame_camera=indices[:, :2],
        observations=seen,
        object_spacing=BOARD.square,
    )
    inputs: dict[str, Any] = {
        'intrinsics': np.concatenate([start, np.zeros((2, 5))], axis=1),
        'observations_board': seen,
        'indices_frame_camintrinsics_camextrinsics': indices,
        'lensmodel': lens,
        'imagersizes': sizes,
        'calibration_object_spacing': BOARD.square,
        'calobject_warp': np.zeros(2),
        'verbose': False,
    }
    inputs |= {'rt_cam_ref': seed[1], 'rt_ref_frame': seed[2]}
    # The usual order: geometry with the core, then the lens, then the board's shape.
    for lens_free, warp_free in ((False, False), (True, False), (True, True)):
        inputs |= {
            'do_optimize_intrinsics_core': True,
            'do_optimize_intrinsics_distortions': lens_free,
            'do_optimize_extrinsics': True,
            'do_optimize_frames': True,
            'do_optimize_calobject_warp': warp_free,
            'do_apply_regularization': False,
            'do_apply_outlier_rejection': False,
        }
        mrcal.optimize(**inputs)
    _, rest, jacobian, _ = mrcal.optimizer_callback(**inputs)
    unit = np.ones(jacobian.shape[1])
    mrcal.unpack_state(unit, **inputs)
    variance = float(rest @ rest) / (len(rest) - len(unit))
    covariance = variance * np.linalg.inv((jacobian.T @ jacobian).toarray())
    covariance *= np.outer(unit, unit)
    focal = mrcal.state_index_intrinsics(0, **inputs)
    first = mrcal.state_index_extrinsics(0, **inputs) + 3
    shift = inputs['rt_cam_ref'][0, 3:]
    length = float(np.linalg.norm(shift))
    spread = shift / length @ covariance[first : first + 3, first : first + 3] @ shift / length
    return Outcome(
        float(inputs['intrinsics'][0, 0]),
        float(np.sqrt(covariance[focal, focal])),
        length,
        float(np.sqrt(spread)),
    )


def compare(rigs: int) -> None:
    """Print and keep errors, stated deviations and time, one row for each program and board."""
    programs: dict[str, Callable[[list[BoardPair]], Outcome]] = {
        'binopos calibrate stereo': ours,
        f'OpenCV {cv2.__version__}': opencv,
    }
    with suppress(PackageNotFoundError):
        programs[f'mrcal {version("mrcal")}'] = with_mrcal
    kept = Figures('calibration/peers', peers=('mrcal',), rigs=rigs)
    print(f'{rigs} rigs, {VIEWS} views of the {BOARD}, {NOISE} px in a coordinate')
    table = kept.table(
        'programs',
        'board',
        Column(''),
        Column('focal length (px)', '.3f'),
        Column('stated', '.3f'),
        Column('baseline (mm)', '.4f'),
        Column('stated', '.4f'),
        Column('s a rig', '.2f'),
    )
    for bow in BOWS:
        worlds = [see(np.random.default_rng(900 + seed), bow) for seed in range(rigs)]
        for name, program in programs.items():
            found, seconds = [], []
            for pairs in worlds:
                begun = time.perf_counter()
                found.append(program(pairs))
                seconds.append(time.perf_counter() - begun)
            focal = _rms([one.focal - FOCAL for one in found])
            baseline = 1000.0 * _rms([one.baseline - BASELINE for one in found])
            stated = _rms([one.focal_deviation for one in found])
            stated_baseline = 1000.0 * _rms([one.baseline_deviation for one in found])
            cells = focal, stated, baseline, stated_baseline, seconds
            table.row(f'bowed by {1000 * bow:g} mm', name, *cells)
    kept.keep()


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rigs', type=int, default=2)
    compare(parser.parse_args().rigs)


if __name__ == '__main__':
    main()
