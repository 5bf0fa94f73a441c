"""One camera alone: `binopos calibrate camera`, and what it looks through."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from binopos_ros.calibration.cameras.alone import calibrate_alone
from binopos_ros.calibration.cameras.lens import AUTO, LENSES
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import Guess
from binopos_ros.calibration.report.files import read_one, write_camera, write_interface_alone
from binopos_ros.calibration.report.page import interface_report
from binopos_ros.calibration.report.summary import summarise_camera, summarise_interface
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import find_board
from binopos_ros.calibration.views.pairs import BoardPair, Dropped
from binopos_ros.calibration.views.pictures import read_picture
from binopos_ros.calibration.views.sources import SUFFIXES
from binopos_ros.calibration.views.view import View
from binopos_ros.cli.progress import progress, working
from binopos_ros.cli.provenance import how_made
from binopos_ros.cli.terminal import fitted
from binopos_ros.optics.rig_state import SHARED
from binopos_ros.sides import SIDES


class Seen(NamedTuple):
    """What one camera's pictures show: views, their size (px), and pictures that are left out."""

    views: Sequence[View]
    size: tuple[int, int]
    dropped: Sequence[Dropped]


def add_camera_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate camera` but for those of its board."""
    parser.add_argument('source', type=Path, metavar='FOLDER', help="the camera's pictures")
    parser.add_argument(
        '--side',
        choices=SIDES,
        default=SIDES[0],
        help='which camera of a rig it is: names its files (default: left)',
    )
    parser.add_argument('--lens', choices=LENSES, default=AUTO, help='lens model (default: auto)')


def calibrate_one(arguments: argparse.Namespace, board: Board) -> int:
    """Calibrate a camera in air; the exit status."""
    seen = see(arguments.source, board, arguments.window)
    with working('calibrating'):
        calibration = calibrate_alone(seen.views, seen.size, arguments.lens)
    paths = write_camera(arguments.output, arguments.side, calibration)
    _tell(summarise_camera(calibration, arguments.side), seen, paths)
    return 0


def calibrate_interface_of_one(
    arguments: argparse.Namespace, board: Board, guesses: Sequence[Guess], output: Path
) -> int:
    """Calibrate what a camera looks through, from its own pictures; the exit status."""
    side = arguments.side
    own = [guess for guess in guesses if guess.place in (SHARED, f'{side}_port')]
    if side != SIDES[0] and own[0].place == SHARED:
        raise CalibrationError(
            f'--side {side}: a shared surface is told in the frame of the {SIDES[0]} camera: '
            f'take its pictures, or those of both, or give --ports'
        )
    if arguments.source is None or arguments.live or arguments.target_diameter is not None:
        raise CalibrationError(f'--side {side}: give a folder of pictures of a board as SOURCE')
    state, covariance = read_one(arguments.calibration, side)
    seen = see(arguments.source, board, arguments.window)
    if seen.size != state.cameras[0].size:
        raise CalibrationError(
            f'the pictures are {seen.size[0]}x{seen.size[1]}, but the camera was calibrated at '
            f'{state.cameras[0].size[0]}x{state.cameras[0].size[1]} px: use the same resolution'
        )
    calibration = calibrate_interface(state, seen.views, own, covariance)
    paths = write_interface_alone(output, side, calibration)
    made = how_made(arguments, arguments.source, arguments.calibration)
    paths.append(interface_report(output, calibration, made, f'{side}_interface.html'))
    _tell(summarise_interface(calibration), seen, paths)
    return 0


def see(source: Path, board: Board, window: int | None) -> Seen:
    """Search a folder of one camera's pictures for the board.

    Raises:
        CalibrationError: no folder, no board, or pictures of different sizes.
    """
    if not source.is_dir():
        raise CalibrationError(f'{source} is no folder of pictures')
    paths = sorted(path for path in source.iterdir() if path.suffix.lower() in SUFFIXES)
    views: list[View] = []
    dropped: list[Dropped] = []
    sizes: set[tuple[int, int]] = set()
    with progress('searching for the board', len(paths)) as tick:
        for path in paths:
            try:
                image = read_picture(path)
            except CalibrationError:
                image = None
            found = None if image is None else find_board(image, board, window)
            if image is None:
                dropped.append(Dropped(path.name, 'no picture that can be read'))
            elif found is None:
                dropped.append(Dropped(path.name, f'no {board} found'))
            else:
                sizes.add((image.shape[1], image.shape[0]))
                pixels = BoardPair(path.name, found, None).view(board).pixels[0]
                views.append(View(path.name, board.points, (pixels,)))
            tick()
    if len(sizes) > 1:
        words = ' and '.join(f'{width}x{height}' for width, height in sorted(sizes))
        raise CalibrationError(f'the pictures have mixed sizes, {words} px: use one resolution')
    if not sizes:
        raise CalibrationError(
            f'no picture of {source} shows the {board}: check the board given, and the light'
        )
    return Seen(views, sizes.pop(), dropped)


def _tell(summary: str, seen: Seen, paths: Sequence[Path]) -> None:
    print(fitted(summary))
    for one in seen.dropped:
        print(f'  {one}')
    for path in paths:
        print(f'written: {path}')
