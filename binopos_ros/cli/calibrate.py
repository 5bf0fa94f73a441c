"""`binopos calibrate`: the cameras, the interface, and whether both still hold."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from binopos_ros.calibration.adjust import View
from binopos_ros.calibration.balls import CENTRE_PER_COORDINATE, ball_view
from binopos_ros.calibration.board import CHESSBOARD, KINDS, Board, parse_size
from binopos_ros.calibration.check import check
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.files import (
    read_stereo,
    write_interface,
    write_stereo,
)
from binopos_ros.calibration.gather import find_boards, name_other_board
from binopos_ros.calibration.interface import calibrate_interface
from binopos_ros.calibration.pairing import FEWEST_PAIRS
from binopos_ros.calibration.priors import guesses_from, parse_numbers
from binopos_ros.calibration.report import interface_report, stereo_report
from binopos_ros.calibration.sources import Pictures, folder_pair, open_pictures
from binopos_ros.calibration.state import LEFT_PORT, RIGHT_PORT, SHARED, Camera, RigState
from binopos_ros.calibration.stereo import MOST_VIEWS, calibrate_stereo
from binopos_ros.calibration.summary import summarise_interface, summarise_stereo
from binopos_ros.calibration.targets import camera_infos_of, target_pairs
from binopos_ros.calibration.views import BoardPair
from binopos_ros.cli.config import Parameters, add_config_argument, config_of_bag
from binopos_ros.cli.status_line import StatusLine
from binopos_ros.optics import stereo_from_camera_infos
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions

HELP = 'make the calibration files of the cameras and of the interface'
BALLS = 60  # more do not change the result, only the time
NOT_HOLDING = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    kinds = parser.add_subparsers(dest='what', metavar='WHAT', required=True)

    stereo = kinds.add_parser('stereo', help='both cameras and their mutual pose, in air')
    _add_source(stereo)
    _add_board(stereo)
    _add_output(stereo, Path('calibration'), 'calibration')
    stereo.add_argument(
        '--most-views', type=int, default=MOST_VIEWS, metavar='N', help='use at most N views'
    )
    stereo.add_argument(
        '--names',
        nargs=2,
        default=('left', 'right'),
        metavar=('LEFT', 'RIGHT'),
        help='camera names for the files',
    )

    interface = kinds.add_parser(
        'interface', help='the surface or the ports, from pictures through them'
    )
    _add_source(interface)
    _add_board(interface)
    _add_output(interface, None, 'interface in the folder of --calibration')
    interface.add_argument(
        '--calibration',
        type=Path,
        required=True,
        metavar='DIR',
        help='folder that `calibrate stereo` has written',
    )
    interface.add_argument(
        '--indices',
        default='1.0,1.333',
        metavar='N0,N1,..',
        help='refractive indices, camera side first (default: 1.0,1.333)',
    )
    interface.add_argument(
        '--thicknesses', default='', metavar='T,..', help='of the layers in between (m)'
    )
    interface.add_argument(
        '--ports', action='store_true', help='a port for each camera, no shared surface'
    )
    interface.add_argument(
        '--prior',
        action='append',
        default=[],
        metavar='NAME=VALUE,SD',
        help='measured by hand: distance=0.80,0.005 (m), target_index=1.333,0.001, '
        'thicknesses.0=0.006,0.0002, normal=0,0,1,2 (direction and degrees), '
        'left_port.distance=..; repeatable, and enough without any pictures',
    )
    interface.add_argument(
        '--target-diameter',
        type=float,
        metavar='M',
        help='the source is a bag of the target of this diameter (m), not of a board',
    )

    daily = kinds.add_parser('check', help='does the calibration still hold? from any bag')
    daily.add_argument('bag', type=Path, metavar='BAG', help='bag of ordinary operation')
    daily.add_argument(
        '--calibration',
        type=Path,
        metavar='DIR',
        help="folder of left.yaml and right.yaml; default: the bag's own camera_info",
    )
    add_config_argument(daily)


def main(arguments: argparse.Namespace) -> int:
    """Run the verb; the exit status."""
    return {'stereo': _stereo, 'interface': _interface, 'check': _check}[arguments.what](arguments)


def _stereo(arguments: argparse.Namespace) -> int:
    board = _board_of(arguments)
    pictures = _pictures_of(arguments)
    pairs, sizes = _search(pictures, board, arguments.window)
    calibration = calibrate_stereo(pairs, board, sizes, arguments.most_views)
    paths = write_stereo(
        arguments.output,
        calibration.state,
        calibration.adjustment.covariance,
        tuple(arguments.names),
    )
    print(summarise_stereo(calibration))
    for one in pictures.unmatched:
        print(f'  {one}')
    paths.append(stereo_report(arguments.output, calibration))
    _print_paths(paths)
    return 0


def _interface(arguments: argparse.Namespace) -> int:
    air, covariance = read_stereo(arguments.calibration)
    output = arguments.output or arguments.calibration / 'interface'
    if output.resolve() == arguments.calibration.resolve():
        raise CalibrationError(
            f'-o {output} would overwrite the calibration in air, which a second run needs: give '
            'another folder'
        )
    guesses = guesses_from(
        parse_numbers(arguments.indices, '--indices'),
        parse_numbers(arguments.thicknesses, '--thicknesses'),
        arguments.ports,
        arguments.prior,
    )
    sigma = None
    if arguments.target_diameter is not None:
        views, sigma = _ball_views(arguments, air)
    elif arguments.source is None and arguments.left is None:
        views = []
    else:
        board = _board_of(arguments)
        pairs, sizes = _search(_pictures_of(arguments), board, arguments.window)
        _same_size(sizes, air)
        views = [pair.view(board) for pair in pairs if pair.complete]
        if not views:
            raise CalibrationError(
                f'no pair shows the {board} in both pictures: check the board given, and the light'
            )
    calibration = calibrate_interface(air, views, guesses, covariance, sigma=sigma)
    paths = write_interface(output, calibration)
    print(summarise_interface(calibration))
    paths.append(interface_report(output, calibration))
    _print_paths(paths)
    return 0


def _check(arguments: argparse.Namespace) -> int:
    covariance = None
    if arguments.calibration is not None:
        state, covariance = read_stereo(arguments.calibration)
    else:
        infos = camera_infos_of(arguments.bag)
        if infos is None:
            raise CalibrationError(
                f'{arguments.bag} holds no camera_info of both cameras: give --calibration DIR'
            )
        left, right, rotation, translation = stereo_from_camera_infos(*infos)
        state = RigState((Camera.of(left), Camera.of(right)), rotation, translation)
    config = config_of_bag(arguments.config, arguments.bag)
    parameters = Parameters(config, arguments.ros_arguments)
    options = build(TriangulatorOptions, parameters.of_node('triangulator'))
    places = zip((SHARED, LEFT_PORT, RIGHT_PORT), options.interfaces(), strict=True)
    interfaces = {place: interface for place, interface in places if interface is not None}
    rig = replace(state, interfaces=interfaces).rig()
    result = check(rig, target_pairs(arguments.bag), covariance)
    print(result.text)
    return 0 if result.holds else NOT_HOLDING


def _add_source(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'source',
        type=Path,
        nargs='?',
        metavar='SOURCE',
        help='folder with left* and right* pictures or sub-folders left and right, a list of '
        'pairs, or a bag',
    )
    parser.add_argument('--left', type=Path, metavar='DIR', help="the left camera's pictures")
    parser.add_argument('--right', type=Path, metavar='DIR', help="the right camera's pictures")
    parser.add_argument(
        '--interval',
        type=float,
        default=0.5,
        metavar='S',
        help='from a bag, take pairs at least this far apart (default: 0.5 s)',
    )


def _add_board(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--board',
        default='9x6',
        metavar='COLUMNSxROWS',
        help='inner corners of a chessboard, squares of a ChArUco board, circles (default: 9x6)',
    )
    parser.add_argument('--square', type=float, metavar='M', help='side of a square (m)')
    parser.add_argument('--kind', choices=KINDS, default=CHESSBOARD, help='kind of board')
    parser.add_argument('--marker', type=float, default=0.0, metavar='M', help='ChArUco marker')
    parser.add_argument('--dictionary', default='DICT_4X4_50', help='ChArUco dictionary')
    parser.add_argument('--legacy', action='store_true', help='ChArUco pattern before OpenCV 4.6')
    parser.add_argument(
        '--window',
        type=int,
        metavar='PX',
        help='half-width of the corner refinement; default: from the size of the squares',
    )


def _add_output(parser: argparse.ArgumentParser, folder: Path | None, words: str) -> None:
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=folder,
        metavar='DIR',
        help=f'folder to write to (default: {words})',
    )


def _board_of(arguments: argparse.Namespace) -> Board:
    if arguments.square is None:
        raise CalibrationError('--square is missing: the printed side of a square in metres')
    columns, rows = parse_size(arguments.board)
    return Board(
        arguments.kind,
        columns,
        rows,
        arguments.square,
        arguments.marker,
        arguments.dictionary,
        arguments.legacy,
    )


def _pictures_of(arguments: argparse.Namespace) -> Pictures:
    if arguments.source is not None:
        return open_pictures(arguments.source, arguments.interval)
    if arguments.left is None or arguments.right is None:
        raise CalibrationError('no pictures: give SOURCE, or --left DIR and --right DIR')
    return folder_pair(arguments.left, arguments.right)


def _search(
    pictures: Pictures, board: Board, window: int | None
) -> tuple[list[BoardPair], tuple[tuple[int, int], tuple[int, int]]]:
    with _progress('searching for the board', len(pictures.pairs)) as tick:
        pairs, sizes = find_boards(pictures.pairs, board, window, tick)
    blank = [i for i, pair in enumerate(pairs) if not pair.complete]
    if len(pairs) - len(blank) < FEWEST_PAIRS and blank:
        other = name_other_board(pictures.pairs[blank[0]].left(), board)
        if other is not None:
            raise CalibrationError(
                f'{pairs[blank[0]].name}: no {board}, but one of {other.columns}x{other.rows} is '
                'there: give the board its right size (a chessboard counts its inner corners)'
            )
    return pairs, sizes


def _same_size(sizes: tuple[tuple[int, int], tuple[int, int]], air: RigState) -> None:
    for name, size, camera in zip(('left', 'right'), sizes, air.cameras, strict=True):
        if size != camera.size:
            raise CalibrationError(
                f'the {name} pictures are {size[0]}x{size[1]}, but the camera was calibrated at '
                f'{camera.size[0]}x{camera.size[1]} px: use the same resolution'
            )


def _ball_views(arguments: argparse.Namespace, air: RigState) -> tuple[list[View], float]:
    """Views of the target, and the standard deviation of their coordinates (px)."""
    if arguments.source is None:
        raise CalibrationError('--target-diameter needs a bag of the target as SOURCE')
    if not 0.0 < arguments.target_diameter < 1.0:
        raise CalibrationError(
            f'--target-diameter {arguments.target_diameter:g}: give metres, as 0.04'
        )
    pairs = target_pairs(arguments.source)
    pairs = pairs[:: max(1, len(pairs) // BALLS)][:BALLS]
    spread = np.median(
        [np.trace(blob.covariance) / 2 for p in pairs for blob in (p.left, p.right)]
    )
    views = [
        ball_view(f'{p.stamp / 1e9:.3f}', air, (p.left, p.right), arguments.target_diameter)
        for p in pairs
    ]
    return views, float(np.sqrt(spread)) / CENTRE_PER_COORDINATE


@contextmanager
def _progress(what: str, total: int) -> Iterator[Callable[[], None]]:
    """A progress bar; without tqdm a line that counts."""
    try:
        from tqdm import tqdm
    except ImportError:
        line, done = StatusLine(), [0]

        def count() -> None:
            done[0] += 1
            line.show(f'{what}: {done[0]} of {total}')

        yield count
        line.end()
        return
    # Into a file or a pipe a bar is noise.
    with tqdm(total=total, desc=what, unit='pair', disable=None) as bar:
        yield lambda: bar.update() and None


def _print_paths(paths: list[Path]) -> None:
    for path in paths:
        print(f'written: {path}')
