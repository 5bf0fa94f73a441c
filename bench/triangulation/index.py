"""The live refractive index: how honest, how near its bound, and how fast.

    python bench/triangulation/index.py            # both tables
    python bench/triangulation/index.py --runs 0   # speed alone

Honesty: for every setting of test/scenes/index_settings.py (the tests' own), runs of 20
pairs with a true index drawn from the prior, errors against the stated deviation (chi-square: 1
is right) and against the Cramer-Rao bound. Here the draws are free; the test draws by strata.

Speed: one pair at a time, as a live node gets them, beside triangulation alone, OpenCV's straight
triangulation, and a general least-squares fit of point and index (scipy).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import cv2
import numpy as np
from scipy import optimize

import index_settings
from binopos_ros.optics import FlatInterface, StereoRig
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.index import IndexEstimator
from figures import Column, Figures

PRIOR_STD = 0.015
RUNS = 400


def honesty(found: Figures, runs: int) -> None:
    random = np.random.default_rng(1)
    print(
        f'{runs} runs of 20 pairs per setting, {index_settings.PIXEL_STD} px, '
        f'prior 1.355 +- {PRIOR_STD}'
    )
    table = found.table(
        'honesty',
        'setting',
        Column('one pair', '.4f'),
        Column('20 pairs, bound', '.5f'),
        Column('RMS error / bound', '.3f'),
        Column('chi-square', '.3f'),
        Column('+-', '.3f'),
    )
    every = []
    for name, setting in index_settings.SETTINGS.items():
        points = index_settings.path(setting, 200, random)
        one = 1.0 / np.linalg.norm(index_settings.information(setting.rig, points), axis=1)
        errors, stds, bound = index_settings.trial(name, runs, 20, PRIOR_STD, random, strata=False)
        squares = (errors / stds) ** 2
        every.append(squares)
        ratio = float(np.sqrt(np.mean(errors**2))) / bound
        chance = np.sqrt(2 / len(squares))
        table.row(name, float(np.median(one)), bound, ratio, squares.mean(), chance)
    squares = np.concatenate(every)
    chance = np.sqrt(2 / len(squares))
    table.row(f'all {len(squares)} runs', None, None, None, squares.mean(), chance)


def speed(found: Figures) -> None:
    setting = index_settings.SETTINGS['washbowl, corner']
    rig, random = setting.rig, np.random.default_rng(2)
    points = index_settings.path(setting, 500, random)
    points[:, 2] = 1.25
    pixels = index_settings.images(
        rig, points
    ) + index_settings.PIXEL_STD * random.standard_normal((500, 4))
    covariance = index_settings.COVARIANCE
    errors = np.diag([0.0 if 'ind' in name else 1e-6 for name in rig.parameter_names])
    plain = IndexEstimator(1.34, PRIOR_STD)
    aided = IndexEstimator(1.34, PRIOR_STD, known_plane=KnownPlane((0, 0, 1), 1.25, 1e-3))
    careful = IndexEstimator(1.34, PRIOR_STD, parameter_covariance=errors)
    leaning = rig_before_a_leaning_pane(rig)
    crossed = IndexEstimator(1.34, PRIOR_STD)
    middle = np.array([0.1, 0.0, 1.25]) + random.uniform(-0.1, 0.1, (500, 3))
    through = iter(np.hstack(leaning.project(middle)).repeat(10, axis=0))
    crossed_errors = np.diag([0.0 if 'ind' in name else 1e-6 for name in leaning.parameter_names])
    crossed_careful = IndexEstimator(1.34, PRIOR_STD, parameter_covariance=crossed_errors)
    calibrated = UncertainRig(rig.left, rig.right, rig.rotation, rig.translation, rig.interface)
    whole = 1e-8 * np.eye(len(calibrated.parameter_names))
    thorough = IndexEstimator(1.34, PRIOR_STD, parameter_covariance=whole)
    left_matrix = rig.left.matrix @ np.eye(3, 4)
    right_matrix = rig.right.matrix @ np.column_stack([rig.rotation, rig.translation])

    def fit(row: np.ndarray) -> None:
        def residual(unknown: np.ndarray) -> np.ndarray:
            found = rig.with_target_index(unknown[3]).project(unknown[:3])
            return (np.concatenate(found) - row) / index_settings.PIXEL_STD

        start = triangulate(rig, row[:2], row[2:]).points
        optimize.least_squares(residual, [*start, rig.target_index], x_scale='jac')

    ways: dict[str, tuple[int, Callable[[np.ndarray], object]]] = {
        'cv2.triangulatePoints (straight, no covariance)': (
            200,
            lambda r: cv2.triangulatePoints(left_matrix, right_matrix, r[:2], r[2:]),
        ),
        'triangulate, with covariance': (
            200,
            lambda r: triangulate(rig, r[:2], r[2:], covariance, covariance),
        ),
        'triangulation and index': (
            200,
            lambda r: update_by(plain, rig, r, covariance),
        ),
        'the same, with a known plane': (
            200,
            lambda r: update_by(aided, rig, r, covariance),
        ),
        'the same, with 3 errors of the surface': (
            200,
            lambda r: update_by(careful, rig, r, covariance),
        ),
        'the first pair of a prior of +- 0.5 (up to 4 linearisations)': (
            200,
            lambda r: update_by(IndexEstimator(1.34, 0.5), rig, r, covariance),
        ),
        'a port each before a leaning pane': (
            200,
            lambda _: update_by(crossed, leaning, next(through), covariance),
        ),
        f'the same, with {np.count_nonzero(crossed_errors)} errors of the surfaces': (
            50,
            lambda _: update_by(crossed_careful, leaning, next(through), covariance),
        ),
        f'one surface, with {len(whole) - 1} errors of a whole calibration': (
            50,
            lambda r: update_by(thorough, calibrated, r, covariance),
        ),
        'point and index by scipy.optimize.least_squares': (5, fit),
    }
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(15):
        for name, (count, way) in ways.items():
            started = time.process_time()
            for row in pixels[:count]:
                way(row)
            taken[name].append(1e6 * (time.process_time() - started) / count)
    own = min(taken['triangulation and index'])
    table = found.table(
        'speed',
        'one pair, processor time',
        Column('us', '.0f'),
        Column('times triangulation and index, by the least', '.2f'),
    )
    for name, each in taken.items():
        table.row(name, each, min(each) / own)


def rig_before_a_leaning_pane(rig: StereoRig) -> StereoRig:
    """The same cameras in housings before a tank's wall: planes at angles."""
    port = FlatInterface((0, 0, 1), 0.02, (1.0, 1.5, 1.333), (0.008,))
    pane = FlatInterface((0.15, 0.1, 1), 0.6, (1.333, 1.5, 1.355), (0.02,))
    return StereoRig(rig.left, rig.right, rig.rotation, rig.translation, pane, port, port)


def update_by(
    estimator: IndexEstimator, rig: StereoRig, row: np.ndarray, covariance: np.ndarray
) -> object:
    return estimator.update(rig, row[:2], row[2:], covariance, covariance)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=RUNS, help='per setting; 0: speed alone')
    runs = parser.parse_args().runs
    found = Figures('triangulation/index', peers=('scipy',))
    if runs:
        honesty(found, runs)
    speed(found)
    if runs == RUNS:
        found.keep()


if __name__ == '__main__':
    main()
