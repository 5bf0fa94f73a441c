"""`binopos calibrate camera`: one camera alone, from a folder of its pictures."""

from __future__ import annotations

import argparse
from pathlib import Path

from binopos_ros.calibration.cameras.alone import calibrate_alone
from binopos_ros.calibration.cameras.lens import AUTO, LENSES
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.report.files import write_camera
from binopos_ros.calibration.report.summary import summarise_camera
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import find_board
from binopos_ros.calibration.views.pairs import BoardPair, Dropped
from binopos_ros.calibration.views.pictures import read_picture
from binopos_ros.calibration.views.sources import SUFFIXES
from binopos_ros.calibration.views.view import View
from binopos_ros.cli.progress import progress
from binopos_ros.cli.terminal import fitted
from binopos_ros.sides import SIDES


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
    """Run it; the exit status."""
    source: Path = arguments.source
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
            found = None if image is None else find_board(image, board, arguments.window)
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
    calibration = calibrate_alone(views, sizes.pop(), arguments.lens)
    paths = write_camera(arguments.output, arguments.side, calibration)
    print(fitted(summarise_camera(calibration, arguments.side)))
    for one in dropped:
        print(f'  {one}')
    for path in paths:
        print(f'written: {path}')
    return 0
