"""`binopos calibrate`: the cameras, the interface, and whether both still hold."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from binopos_ros.calibration.cameras.rigidity import FEWEST_PAIRS
from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.check.daily import check
from binopos_ros.calibration.check.doubled import refraction
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import Guess
from binopos_ros.calibration.interface.priors import Media, guesses_from, parse_numbers
from binopos_ros.calibration.live.guidance import Sizes, Solution, Solve
from binopos_ros.calibration.live.session import LiveSession
from binopos_ros.calibration.report.files import (
    read_intrinsics,
    read_stereo,
    write_interface,
    write_stereo,
)
from binopos_ros.calibration.report.page import interface_report, stereo_report
from binopos_ros.calibration.report.summary import summarise_interface, summarise_stereo
from binopos_ros.calibration.views.balls import CENTRE_PER_COORDINATE, ball_view
from binopos_ros.calibration.views.board import Board, parse_size
from binopos_ros.calibration.views.gather import Gathered, find_boards
from binopos_ros.calibration.views.other_board import refuse_other_board
from binopos_ros.calibration.views.pairs import BoardPair, Dropped
from binopos_ros.calibration.views.pictures import Pictures
from binopos_ros.calibration.views.sources import folder_pair
from binopos_ros.calibration.views.view import View
from binopos_ros.capture.usb import find_cameras
from binopos_ros.cli.calibrate_arguments import add_arguments
from binopos_ros.cli.calibrate_camera import calibrate_interface_of_one, calibrate_one
from binopos_ros.cli.calibrate_report import report
from binopos_ros.cli.calibration_bags import camera_infos_of, open_pictures, target_pairs
from binopos_ros.cli.config import layers, parameters_of, ros_words
from binopos_ros.cli.convert_calibration import convert
from binopos_ros.cli.fixed_target import fixed_target_text
from binopos_ros.cli.progress import progress, working
from binopos_ros.cli.provenance import how_made
from binopos_ros.cli.rig_file import next_step, write_rig
from binopos_ros.cli.stereo_topics import choice_of
from binopos_ros.cli.terminal import fitted
from binopos_ros.node_options import NODES, Parameters
from binopos_ros.nodes.ros import require_ros
from binopos_ros.optics import read_camera_info, stereo_from_camera_infos
from binopos_ros.optics.rig_state import LEFT_PORT, RIGHT_PORT, SHARED, Camera, RigState
from binopos_ros.parameters import build
from binopos_ros.pipeline import detector_options, make_platform
from binopos_ros.sheet import Made
from binopos_ros.sides import SIDES
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.surface_options import DOME, FLAT

__all__ = ['add_arguments', 'main']

BALLS = 60  # more do not change the result, only the time
NOT_HOLDING = 1
#: Arguments that name what a calibration is made of.
INPUTS = ('source', 'left', 'right', 'calibration', 'intrinsics', 'config')


def main(arguments: argparse.Namespace) -> int:
    """Run the verb; the exit status."""
    _quieten_opencv()
    _refuse_slips(arguments)
    if arguments.what == 'camera':
        return calibrate_one(arguments, _board_of(arguments))
    kinds = {
        'stereo': _stereo,
        'interface': _interface,
        'check': _check,
        'report': report,
        'convert': convert,
    }
    return kinds[arguments.what](arguments)


def _refuse_slips(arguments: argparse.Namespace) -> None:
    """See that what is given for nodes could be theirs, whether or not this kind runs them."""
    parameters = Parameters(layers(arguments), arguments.ros_arguments)
    for name in NODES:
        parameters.of_node(name)


def _quieten_opencv() -> None:
    """Keep OpenCV from printing of its own about pictures in which it finds no marker."""
    logging = getattr(getattr(cv2, 'utils', None), 'logging', None)
    if logging is not None:
        logging.setLogLevel(logging.LOG_LEVEL_ERROR)


def _stereo(arguments: argparse.Namespace) -> int:
    board = _board_of(arguments)
    given = read_intrinsics(arguments.intrinsics) if arguments.intrinsics else None
    calibrated = partial(calibrate_stereo, board=board, lens=arguments.lens, given=given)

    def solve(pairs: Sequence[BoardPair], sizes: Sizes) -> Solution:
        fit = calibrated(pairs, sizes=sizes).adjustment
        return Solution(fit.state, fit.covariance, fit.free, fit.effective_sigma, fit.poses)

    pairs, sizes, unmatched = _views_of(arguments, board, solve)
    with working('calibrating'):
        calibration = calibrated(pairs, sizes=sizes, most_views=arguments.most_views)
    paths = write_stereo(
        arguments.output,
        calibration.state,
        calibration.adjustment.covariance,
        tuple(arguments.names),
    )
    print(fitted(summarise_stereo(calibration)))
    for one in unmatched:
        print(f'  {one}')
    paths.append(stereo_report(arguments.output, calibration, _made(arguments)))
    _print_paths(paths)
    return 0


def _interface(arguments: argparse.Namespace) -> int:
    output = arguments.output or arguments.calibration / 'interface'
    if output.resolve() == arguments.calibration.resolve():
        raise CalibrationError(
            f'-o {output} would overwrite the calibration in air, which a second run needs: give '
            'another folder'
        )
    guesses = _guesses_of(arguments)
    if arguments.side is not None:
        return calibrate_interface_of_one(arguments, _board_of(arguments), guesses, output)
    air, covariance = read_stereo(arguments.calibration)
    sigma: float | None = None
    left_out: Sequence[Dropped] = ()
    if arguments.target_diameter is not None:
        views, sigma = _ball_views(arguments, air)
    elif arguments.source is None and not arguments.left and not arguments.live:
        views = []
    else:
        board = _board_of(arguments)

        def solve(pairs: Sequence[BoardPair], sizes: Sizes) -> Solution:
            seen = [pair.view(board) for pair in pairs]
            found = calibrate_interface(air, seen, guesses, covariance)
            fit = found.adjustment
            assert fit is not None
            return Solution(
                found.state, found.covariance, fit.free, fit.effective_sigma, fit.poses
            )

        pairs, sizes, left_out = _views_of(arguments, board, solve)
        _same_size(sizes, air)
        views = [pair.view(board) for pair in pairs if pair.complete]
        if not views:
            raise CalibrationError(
                f'no pair shows the {board} in both pictures: check the board given, and the light'
            )
    with working('calibrating'):
        calibration = calibrate_interface(air, views, guesses, covariance, sigma=sigma)
    paths = write_interface(output, calibration)
    print(fitted(summarise_interface(calibration)))
    for one in left_out:
        print(f'  {one}')
    paths.append(interface_report(output, calibration, _made(arguments)))
    rig, missing = write_rig(
        output,
        paths[0].read_text(encoding='utf-8'),
        {side: read_camera_info(output / f'{side}.yaml') for side in SIDES},
        frozenset(camera.serial for camera in find_cameras() if camera.serial),
        arguments.target_diameter,
    )
    _print_paths([*paths, rig])
    print(f'Next: {next_step(rig, missing)}')
    return 0


def _guesses_of(arguments: argparse.Namespace) -> list[Guess]:
    radius = _radius_of(arguments)

    def media(prefix: str, radius: float | None = None) -> Media:
        indices, thicknesses = (f'{prefix}{word}' for word in ('indices', 'thicknesses'))
        return Media(
            parse_numbers(getattr(arguments, indices), f'--{indices.replace("_", "-")}'),
            parse_numbers(getattr(arguments, thicknesses), f'--{thicknesses.replace("_", "-")}'),
            radius,
        )

    if not arguments.ports:
        if arguments.surface_indices:
            raise CalibrationError(
                '--surface-indices are of a surface behind ports: add --ports, or give --indices'
            )
        return guesses_from(media(''), None, arguments.prior)
    behind = media('surface_') if arguments.surface_indices else None
    return guesses_from(behind, media('', radius), arguments.prior)


def _radius_of(arguments: argparse.Namespace) -> float | None:
    """The inner radius of domes, m; None where ports are flat."""
    if arguments.shape == FLAT:
        if arguments.radius:
            raise CalibrationError(f'--radius is of domes: add --shape {DOME}')
        return None
    if not arguments.ports:
        raise CalibrationError(f'--shape {DOME}: each camera has its own dome, so add --ports')
    return float(arguments.radius)


def _check(arguments: argparse.Namespace) -> int:
    covariance = None
    if arguments.calibration is not None:
        state, covariance = read_stereo(arguments.calibration)
    else:
        infos = camera_infos_of(arguments.bag, choice_of(arguments))
        left, right, rotation, translation = stereo_from_camera_infos(*infos)
        state = RigState((Camera.of(left), Camera.of(right)), rotation, translation)
    parameters = parameters_of(arguments, arguments.bag)
    options = build(TriangulatorOptions, parameters.of_node('triangulator'))
    places = zip((SHARED, LEFT_PORT, RIGHT_PORT), options.interfaces(), strict=True)
    interfaces = {place: interface for place, interface in places if interface is not None}
    rig = replace(state, interfaces=interfaces).rig()
    targets = target_pairs(
        arguments.bag, detector_options(parameters.of_node('detector')), choice_of(arguments)
    )
    seen = (
        np.array([pair.left.centre for pair in targets]),
        np.array([pair.right.centre for pair in targets]),
        np.array([pair.left.covariance for pair in targets]),
        np.array([pair.right.covariance for pair in targets]),
    )
    found = triangulate(rig, *seen)
    straight = triangulate(state.rig(), *seen)
    twice = refraction(rig, found.points, found.residuals, straight.points, straight.residuals)
    if twice.text:
        print(twice.text)
    if twice.is_twice:
        return NOT_HOLDING
    result = check(rig, found.points, found.residuals, covariance)
    print(fitted(result.text))
    platform = make_platform(parameters.of_node('smoother'))
    if platform.active:
        choice, stamps = choice_of(arguments), [pair.stamp for pair in targets]
        positions = stamps, found.points, found.covariances
        print(fixed_target_text(arguments.bag, choice, platform, *positions))
    return 0 if result.holds else NOT_HOLDING


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
        return open_pictures(
            arguments.source, arguments.interval, choice_of(arguments), arguments.layout
        )
    if not arguments.left or not arguments.right:
        raise CalibrationError('no pictures: give SOURCE, or --left DIR and --right DIR')
    return folder_pair(Path(arguments.left), Path(arguments.right))


def _views_of(
    arguments: argparse.Namespace, board: Board, solve: Solve
) -> tuple[Sequence[BoardPair], Sizes, Sequence[Dropped]]:
    """The board in all pairs, the pictures' sizes, and pictures that are left out."""
    if arguments.live:
        return (*_taken_live(arguments, board, solve), ())
    pictures = _pictures_of(arguments)
    pairs, sizes, dropped = _search(pictures, board, arguments.window)
    return pairs, sizes, (*pictures.unmatched, *dropped)


def _taken_live(
    arguments: argparse.Namespace, board: Board, solve: Solve
) -> tuple[Sequence[BoardPair], Sizes]:
    require_ros()
    import rclpy

    from binopos_ros.nodes.calibrator import CalibratorNode
    from binopos_ros.nodes.running import run

    for name in ('wanted', 'distance'):
        if not getattr(arguments, name) > 0.0:
            raise CalibrationError(f'--{name} {getattr(arguments, name):g}: give metres above 0')
    session = LiveSession(board, solve, arguments.wanted, arguments.distance, arguments.window)
    clear = '\x1b[H\x1b[2J' if sys.stdout.isatty() else ''
    print('waiting for pictures of both cameras ...', flush=True)
    # Ctrl-C ends the taking, not the verb: what was taken is calibrated.
    before = signal.signal(signal.SIGINT, lambda *_: rclpy.try_shutdown())
    try:
        run(
            {
                'calibrator': partial(
                    CalibratorNode, session, lambda text: print(f'{clear}{text}', flush=True)
                )
            },
            ros_words(layers(arguments), arguments.ros_arguments),
        )
    finally:
        signal.signal(signal.SIGINT, before)
    if session.guidance is None or not session.pairs:
        raise CalibrationError(
            'no view was taken: are left/image_raw and right/image_raw published under /stereo, '
            'and is all of the board in both pictures?'
        )
    return session.pairs, session.guidance.sizes


def _search(pictures: Pictures, board: Board, window: int | None) -> Gathered:
    with progress('searching for the board', len(pictures.pairs)) as tick:
        found = find_boards(pictures.pairs, board, window, tick)
    refuse_other_board(pictures.pairs, found.pairs, board, FEWEST_PAIRS)
    return found


def _same_size(sizes: Sizes, air: RigState) -> None:
    for name, size, camera in zip(SIDES, sizes, air.cameras, strict=True):
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
    parameters = parameters_of(arguments, arguments.source)
    detection = detector_options(parameters.of_node('detector'))
    pairs = target_pairs(arguments.source, detection, choice_of(arguments))
    pairs = pairs[:: max(1, len(pairs) // BALLS)][:BALLS]
    spread = np.median(
        [np.trace(blob.covariance) / 2 for p in pairs for blob in (p.left, p.right)]
    )
    views = [
        ball_view(f'{p.stamp / 1e9:.3f}', air, (p.left, p.right), arguments.target_diameter)
        for p in pairs
    ]
    return views, float(np.sqrt(spread)) / CENTRE_PER_COORDINATE


def _made(arguments: argparse.Namespace) -> Made:
    given = (getattr(arguments, name, None) for name in INPUTS)
    return how_made(arguments, *(Path(each) for each in given if each))


def _print_paths(paths: list[Path]) -> None:
    for path in paths:
        print(f'written: {path}')
