"""The real chessboard pairs, and simulated rigs whose boards are known exactly."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import find_board
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import exponential

SIZE = (1280, 960)


@pytest.fixture(scope='session')
def sample_board() -> Board:
    """The board of opencv-stereo-samples."""
    return Board('chessboard', 9, 6, 0.025)


@pytest.fixture(scope='session')
def samples(shared_data: Path) -> Path:
    """Folder of the real pairs."""
    return shared_data / 'opencv-stereo-samples'


@pytest.fixture(scope='session')
def sample_pairs(samples: Path, sample_board: Board) -> list[BoardPair]:
    """The boards in all real pairs, refined as by default."""
    pairs = []
    for left in sorted(samples.glob('left??.jpg')):
        right = left.with_name(left.name.replace('left', 'right'))
        found = [find_board(cv2.imread(str(path), 0), sample_board) for path in (left, right)]
        pairs.append(BoardPair(left.stem[-2:], found[0], found[1]))
    return pairs


Rig = tuple[StereoRig, tuple[float, float]]


def make_rig(kind: str, rng: np.random.Generator) -> Rig:
    """A rig that looks through a surface, a tank's wall, ports, or ports and a wall behind them
    ('housing'), and the depths of its targets."""
    focal = rng.uniform(800.0, 1000.0)
    matrix = np.array([[focal, 0.0, 639.5], [0.0, focal, 479.5], [0.0, 0.0, 1.0]])
    cameras = [
        PinholeCamera(matrix, [-0.1, 0.05, 0.001, -0.001, 0.01], SIZE) for _ in ('left', 'right')
    ]
    water = rng.uniform(1.325, 1.345)
    slope = rng.normal(size=2) * np.radians(5.0)
    normal = [slope[0], slope[1], 1.0]
    baseline, turn = (0.12, 0.05) if kind == 'ports' else (0.23, 0.12)
    rotation = exponential(np.array([0.0, turn, 0.0]))
    translation = -rotation @ [baseline, 0.0, 0.0]
    if kind == 'surface':
        distance = rng.uniform(0.7, 0.9)
        interfaces = {'interface': FlatInterface(normal, distance, (1.0, water))}
        depths = (distance + 0.15, distance + 0.5)
    elif kind in ('wall', 'housing'):
        distance = rng.uniform(0.5, 0.7)
        wall = FlatInterface(normal, distance, (1.0, 1.49, water), (0.012,))
        interfaces = {'interface': wall}
        for place in ('left_port', 'right_port') if kind == 'housing' else ():
            slope = rng.normal(size=2) * np.radians(2.0)
            interfaces[place] = FlatInterface(
                [slope[0], slope[1], 1.0], rng.uniform(0.02, 0.05), (1.0, 1.49, 1.0), (0.01,)
            )
        depths = (distance + 0.16, distance + 0.5)
    else:
        interfaces = {}
        for place in ('left_port', 'right_port'):
            slope = rng.normal(size=2) * np.radians(2.0)
            interfaces[place] = FlatInterface(
                [slope[0], slope[1], 1.0], rng.uniform(0.02, 0.05), (1.0, 1.47, water), (0.008,)
            )
        depths = (0.45, 0.9)
    return StereoRig(cameras[0], cameras[1], rotation, translation, **interfaces), depths


def see_boards(
    rig: StereoRig,
    depths: tuple[float, float],
    rng: np.random.Generator,
    count: int = 10,
    noise: float = 0.1,
    tilts: tuple[float, float] = (0.0, 45.0),
    aside: tuple[float, float] = (0.15, 0.1),
    bow: float = 0.0,
) -> list[View]:
    """Boards of 9 x 6 corners, 20 mm apart, mixed in tilt and place, whole in both pictures.

    `aside` is how far from the axis they are held, in parts of their depth; `bow` by how much
    they are bent along their rows (m at the edge), which the views do not tell.
    """
    points = Board('chessboard', 9, 6, 0.02).points
    middle = points.mean(axis=0)
    away = points[:, 0] - middle[0]
    bent = points - middle + np.outer(bow * (away / away.max()) ** 2, [0.0, 0.0, 1.0])
    centre = -rig.rotation.T @ rig.translation / 2.0
    views: list[View] = []
    while len(views) < count:
        tilt, about = np.radians(rng.uniform(*tilts)), rng.uniform(0.0, 2.0 * np.pi)
        turned = exponential(tilt * np.array([np.cos(about), np.sin(about), 0.0]))
        turned = turned @ exponential(np.array([0.0, 0.0, rng.uniform(-0.5, 0.5)]))
        depth = rng.uniform(*depths)
        place = [
            centre[0] + rng.uniform(-1.0, 1.0) * aside[0] * depth,
            rng.uniform(-1.0, 1.0) * aside[1] * depth,
            depth,
        ]
        seen = rig.project(bent @ turned.T + place)
        if all(
            np.isfinite(p).all() and (p > 5).all() and (p < np.array(SIZE) - 5).all() for p in seen
        ):
            noisy = tuple(p + rng.normal(scale=noise, size=p.shape) for p in seen)
            views.append(View(f'view {len(views)}', points, noisy))
    return views


def guesses_for(rig: StereoRig) -> list[InterfaceGuess]:
    """What a user knows: the glass and its thickness, roughly the water, no distance, no tilt."""
    return [
        InterfaceGuess(
            place,
            (1.0, *interface.indices[1:-1], 1.0 if interface.indices[-1] == 1.0 else 1.333),
            interface.thicknesses,
        )
        for place in ('interface', 'left_port', 'right_port')
        if (interface := getattr(rig, place)) is not None
    ]


def make_dry_rig(media: FlatInterface) -> StereoRig:
    """A rig before a plate, a dry window, or a tank that is seen through."""
    matrix = [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]]
    camera = PinholeCamera(matrix, [-0.1, 0.05, 0.001, -0.001, 0.01], SIZE)
    rotation = exponential(np.array([0.0, 0.1, 0.0]))
    return StereoRig(camera, camera, rotation, -rotation @ [0.23, 0.0, 0.0], media)


@pytest.fixture(scope='session')
def dry_rig() -> Callable[[FlatInterface], StereoRig]:
    """`make_dry_rig`."""
    return make_dry_rig


@pytest.fixture(scope='session')
def rig_maker() -> Callable[..., Rig]:
    """`make_rig`."""
    return make_rig


@pytest.fixture(scope='session')
def board_viewer() -> Callable[..., list[View]]:
    """`see_boards`."""
    return see_boards


@pytest.fixture(scope='session')
def guesser() -> Callable[[StereoRig], list[InterfaceGuess]]:
    """`guesses_for`."""
    return guesses_for
