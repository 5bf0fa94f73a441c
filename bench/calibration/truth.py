"""Time and truth of the calibrations, beside OpenCV's, on rendered pictures and simulated rigs.

python bench/calibration/truth.py                 both tables
python bench/calibration/truth.py --rigs 500      more rigs in the second one
python bench/calibration/truth.py --only stereo   the first alone
python bench/calibration/truth.py --middle        boards in the middle of the pictures alone
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import cv2
import numpy as np

from binopos_ros.calibration.adjustment.positions import calibration_covariances
from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.gather import find_boards
from binopos_ros.calibration.views.pictures import PicturePair
from binopos_ros.calibration.views.view import View
from binopos_ros.cli import main as binopos
from binopos_ros.cli.calibration_bags import open_pictures
from binopos_ros.optics import (
    FlatInterface,
    PinholeCamera,
    StereoRig,
    read_camera_info,
    stereo_from_camera_infos,
)
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RigState, exponential
from binopos_ros.triangulation import triangulate
from figures import Column, Figures

BOARD = Board('chessboard', 9, 6, 0.02)
SIZE = (1280, 960)
PAIRS = 40
NOISE = 0.1  # px
KINDS = ('surface', 'wall', 'ports', 'housing')
PORTS = ('left_port', 'right_port')
#: How far aside the boards are held, in parts of their depth: anywhere in the pictures of both
#: cameras, or in the middle alone.
EVERYWHERE, MIDDLE = (0.6, 0.5), (0.15, 0.1)
TARGETS_ASIDE = (0.3, 0.25)
#: 95 % quantiles of chi^2 with 4 and 7 degrees of freedom.
REGION = {4: 9.488, 7: 14.067}


@dataclass(frozen=True)
class Row:
    """One way to calibrate: seconds, errors of focal length (px) and baseline (mm), RMS (px)."""

    name: str
    seconds: float
    focal: float
    baseline: float
    rms: float


def compare_stereo(folder: Path) -> None:
    """Print and keep 40 rendered pairs of 1280 x 960: this suite and OpenCV's functions."""
    kept = Figures('calibration/truth.stereo')
    bag = folder / 'dry'
    line = f'simulate -o {bag} --board 9x6 --air --pairs {PAIRS} --rate 2 --seed 1'
    if binopos(line.split()) != 0:
        raise SystemExit('the pictures could not be rendered')
    infos = [read_camera_info(bag / f'{side}.yaml') for side in ('left', 'right')]
    left, _, _, translation = stereo_from_camera_infos(*infos)
    pictures = open_pictures(bag).pairs
    focal, baseline = left.matrix[0, 0], float(np.linalg.norm(translation))
    rows = [ours(pictures, focal, baseline), opencv(pictures, focal, baseline)]
    table = kept.table(
        'programs',
        f'{PAIRS} pairs of {SIZE[0]} x {SIZE[1]}, errors against the rendered truth',
        Column('s', '.1f'),
        Column("times OpenCV's", '.2f', '>'),
        Column('focal (px)', '+.2f'),
        Column('baseline (mm)', '+.3f'),
        Column('RMS (px)', '.3f'),
    )
    for row in rows:
        ratio = row.seconds / rows[1].seconds
        table.row(row.name, row.seconds, ratio, row.focal, row.baseline, row.rms)
    kept.keep()


def ours(pictures: tuple[PicturePair, ...], focal: float, baseline: float) -> Row:
    """`binopos calibrate stereo`, cross-validation and lens test included."""
    start = time.perf_counter()
    pairs, sizes, _ = find_boards(pictures, BOARD)
    result = calibrate_stereo(pairs, BOARD, sizes)
    seconds = time.perf_counter() - start
    length = float(np.linalg.norm(result.state.translation))
    return Row(
        'binopos calibrate stereo',
        seconds,
        float(result.state.cameras[0].focal[0]) - focal,
        1000.0 * (length - baseline),
        result.adjustment.rms(),
    )


def opencv(pictures: tuple[PicturePair, ...], focal: float, baseline: float) -> Row:
    """The usual script: corners with an 11 px window, each camera, then the pair together."""
    start = time.perf_counter()
    found: list[list[np.ndarray]] = [[], []]
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    for pair in pictures:
        corners = []
        for load in (pair.left, pair.right):
            image = load()
            good, rough = cv2.findChessboardCorners(image, BOARD.shape, flags=flags)
            if good:
                criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 30, 1e-3)
                corners.append(cv2.cornerSubPix(image, rough, (11, 11), (-1, -1), criteria))
        if len(corners) == 2:
            found[0].append(corners[0])
            found[1].append(corners[1])
    points = [BOARD.points.astype(np.float32)] * len(found[0])
    single = [cv2.calibrateCamera(points, f, SIZE, np.eye(3), np.zeros(5)) for f in found]
    rms, matrix, *_, translation, _, _ = cv2.stereoCalibrate(
        points,
        *found,
        single[0][1],
        single[0][2],
        single[1][1],
        single[1][2],
        SIZE,
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
    )
    seconds = time.perf_counter() - start
    length = float(np.linalg.norm(translation))
    return Row(
        f'OpenCV {cv2.__version__} functions',
        seconds,
        float(matrix[0, 0]) - focal,
        1000.0 * (length - baseline),
        float(rms),
    )


def judge_interface(
    rigs: int, views: int, index: float, ruler: float, aside: tuple[float, float]
) -> None:
    """Print and keep simulated rigs: errors, stated deviations, coverage, positions."""
    print(f'the {BOARD} tilted by 15-55 degrees, {NOISE} px')
    way = '.middle' if aside == MIDDLE else ''
    way += '.known' if index > 0 or ruler > 0 else ''
    kept = Figures(
        f'calibration/truth.interface{way}',
        rigs=rigs,
        views=views,
        index_known_to=index or None,
        distance_measured_to=ruler or None,
    )
    table = kept.table(
        'kinds',
        '',
        Column('index', '.4f'),
        Column('normal (deg)', '.3f'),
        Column('distance (mm)', '.2f'),
        Column('in the 95 % region, %', '.1f'),
        Column('position / bound', '.2f'),
        Column('position / exact rig', '.2f'),
    )
    whole: list[bool] = []
    every: list[tuple[float, float]] = []
    for kind in KINDS:
        errors: dict[str, list[float]] = {'index': [], 'normal': [], 'distance': []}
        inside: list[bool] = []
        squares: list[tuple[float, float, float]] = []
        for seed in range(rigs // len(KINDS)):
            rng = np.random.default_rng(50_000 + seed)
            rig, depths = make_rig(kind, rng)
            truth = RigState.of(rig)
            seen = see_boards(rig, depths, rng, views, aside)
            air = replace(truth, interfaces={})
            water = float(rig.target_index) + index * rng.normal()
            guesses = [measured(rig, one, water, index, ruler, rng) for one in guesses_for(rig)]
            result = calibrate_interface(air, seen, guesses)
            error = -truth.minus(result.state)
            own = [
                i
                for i, name in enumerate(result.state.names)
                if name in result.prior
                and 'thick' not in name
                and 'indices' not in name
                and not (kind == 'housing' and 'port' in name)  # a plate, which hardly matters
            ]
            for i in own:
                errors[next(k for k in errors if k in result.state.names[i])].append(error[i])
            block = result.covariance[np.ix_(own, own)]
            inside.append(bool(error[own] @ np.linalg.solve(block, error[own]) < REGION[len(own)]))
            squares.append(position_squares(rig, depths, result.state, result.covariance, rng))
        whole += inside
        rms = {name: float(np.sqrt(np.mean(np.square(e)))) for name, e in errors.items()}
        error_square, bound, exact = np.mean(squares, axis=0)
        every.append((error_square / bound, error_square / exact))
        table.row(
            kind,
            rms['index'],
            np.degrees(rms['normal']),
            1000 * rms['distance'],
            100 * np.mean(inside),
            np.sqrt(error_square / bound),
            np.sqrt(error_square / exact),
        )
    to_bound, to_exact = np.sqrt(np.mean(every, axis=0))
    inside_all = 100 * np.mean(whole)
    table.row(f'all {len(whole)}', None, None, None, inside_all, to_bound, to_exact)
    kept.keep()


def position_squares(
    rig: StereoRig,
    depths: tuple[float, float],
    state: RigState,
    covariance: np.ndarray,
    rng: np.random.Generator,
) -> tuple[float, float, float]:
    """Mean squares (m^2): an independent target's error, its bound, the bound of an exact rig."""
    depth = rng.uniform(*depths, 100)
    centre = -rig.rotation.T @ rig.translation / 2.0
    aside = rng.uniform(-1.0, 1.0, (100, 2)) * TARGETS_ASIDE * depth[:, None]
    points = np.column_stack([centre[:2] + aside, depth])
    pixels = [p + rng.normal(scale=NOISE, size=p.shape) for p in rig.project(points)]
    pixel = NOISE**2 * np.eye(2)
    found = triangulate(state.rig(), *pixels, pixel, pixel)
    good = found.reasons == ''
    known = ParameterCovariance(state.names, covariance)
    added = calibration_covariances(state, found.points[good], known)
    exact = np.trace(found.covariances[good], axis1=1, axis2=2)
    square = np.sum((found.points[good] - points[good]) ** 2, axis=1)
    bound = exact + np.trace(added, axis1=1, axis2=2)
    return float(square.mean()), float(bound.mean()), float(exact.mean())


def make_rig(kind: str, rng: np.random.Generator) -> tuple[StereoRig, tuple[float, float]]:
    """A rig that looks through a surface, a tank's wall, ports, or plane-parallel ports of a
    housing before a tank's wall; and its targets' depths."""
    focal = rng.uniform(800.0, 1000.0)
    matrix = np.array([[focal, 0.0, 639.5], [0.0, focal, 479.5], [0.0, 0.0, 1.0]])
    camera = PinholeCamera(matrix, [-0.1, 0.05, 0.001, -0.001, 0.01], SIZE)
    water = rng.uniform(1.325, 1.345)
    baseline, turn = (0.12, 0.05) if kind == 'ports' else (0.23, 0.12)
    rotation = exponential(np.array([0.0, turn, 0.0]))
    slopes = rng.normal(size=(2, 2)) * np.radians(2.0 if kind == 'ports' else 5.0)
    if kind == 'surface':
        distance = rng.uniform(0.7, 0.9)
        surfaces = {'interface': FlatInterface([*slopes[0], 1.0], distance, (1.0, water))}
        depths = (distance + 0.15, distance + 0.5)
    elif kind in ('wall', 'housing'):
        distance = rng.uniform(0.5, 0.7)
        wall = FlatInterface([*slopes[0], 1.0], distance, (1.0, 1.49, water), (0.012,))
        surfaces = {'interface': wall}
        for place in PORTS if kind == 'housing' else ():
            slope = rng.normal(size=2) * np.radians(2.0)
            surfaces[place] = FlatInterface(
                [*slope, 1.0], rng.uniform(0.02, 0.05), (1.0, 1.49, 1.0), (0.01,)
            )
        depths = (distance + 0.16, distance + 0.5)
    else:
        surfaces = {
            place: FlatInterface(
                [*slope, 1.0], rng.uniform(0.02, 0.05), (1.0, 1.47, water), (0.008,)
            )
            for place, slope in zip(PORTS, slopes, strict=True)
        }
        depths = (0.45, 0.9)
    return StereoRig(
        camera, camera, rotation, -rotation @ [baseline, 0.0, 0.0], **surfaces
    ), depths


def see_boards(
    rig: StereoRig,
    depths: tuple[float, float],
    rng: np.random.Generator,
    count: int,
    aside: tuple[float, float],
) -> list[View]:
    """Boards of mixed tilts, whole in both pictures."""
    middle = BOARD.points.mean(axis=0)
    centre = -rig.rotation.T @ rig.translation / 2.0
    views: list[View] = []
    while len(views) < count:
        tilt, about = np.radians(rng.uniform(15.0, 55.0)), rng.uniform(0.0, 2.0 * np.pi)
        turned = exponential(tilt * np.array([np.cos(about), np.sin(about), 0.0]))
        turned = turned @ exponential(np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)]))
        depth = rng.uniform(*depths)
        x, y = depth * rng.uniform(-1.0, 1.0, 2) * aside
        place = np.array([centre[0] + x, y, depth])
        seen = rig.project((BOARD.points - middle) @ turned.T + place)
        if all(np.isfinite(p).all() and (p > 5).all() and (p < [1275, 955]).all() for p in seen):
            noisy = tuple(p + rng.normal(scale=NOISE, size=p.shape) for p in seen)
            views.append(View(f'{len(views)}', BOARD.points, noisy))
    return views


def guesses_for(rig: StereoRig) -> list[InterfaceGuess]:
    """What a user knows: glass and its thickness, about the water, no distance, no tilt."""
    return [
        InterfaceGuess(
            place,
            (1.0, *surface.indices[1:-1], 1.0 if surface.indices[-1] == 1.0 else 1.333),
            surface.thicknesses,
        )
        for place in ('interface', *PORTS)
        if (surface := getattr(rig, place)) is not None
    ]


def measured(
    rig: StereoRig,
    guess: InterfaceGuess,
    water: float,
    index: float,
    ruler: float,
    rng: np.random.Generator,
) -> InterfaceGuess:
    """A guess with the index `water` known to `index`, the distance to `ruler` (m), if > 0."""
    if index > 0.0 and guess.indices[-1] > 1.0:
        indices = (*guess.indices[:-1], water)
        guess = replace(guess, indices=indices, deviations={'target_index': index})
    if ruler > 0.0 and guess.indices[-1] > 1.0:
        distance = getattr(rig, guess.place).distance + ruler * rng.normal()
        guess = replace(
            guess, distance=distance, deviations={**guess.deviations, 'distance': ruler}
        )
    return guess


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rigs', type=int, default=200)
    parser.add_argument('--views', type=int, default=10)
    parser.add_argument('--known-index', type=float, default=0.0, metavar='SD')
    parser.add_argument('--ruler', type=float, default=0.0, metavar='SD', help='m')
    parser.add_argument('--middle', action='store_true')
    parser.add_argument('--only', choices=('stereo', 'interface'))
    arguments = parser.parse_args()
    if arguments.only != 'interface':
        with tempfile.TemporaryDirectory() as folder:
            compare_stereo(Path(folder))
    if arguments.only != 'stereo':
        aside = MIDDLE if arguments.middle else EVERYWHERE
        judge_interface(
            arguments.rigs, arguments.views, arguments.known_index, arguments.ruler, aside
        )


if __name__ == '__main__':
    main()
