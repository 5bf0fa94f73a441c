"""The arguments of `binopos calibrate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from binopos_ros.calibration.cameras.lens import AUTO, LENSES
from binopos_ros.calibration.cameras.stereo import MOST_VIEWS
from binopos_ros.calibration.views.board import CHESSBOARD, KINDS
from binopos_ros.calibration.views.packed import LAYOUTS
from binopos_ros.cli.calibrate_camera import add_camera_arguments
from binopos_ros.cli.calibrate_report import add_report_arguments
from binopos_ros.cli.config import add_config_argument
from binopos_ros.cli.convert_calibration import add_convert_arguments
from binopos_ros.cli.stereo_topics import add_remap_argument, add_topic_arguments
from binopos_ros.sides import SIDES
from binopos_ros.triangulation.surface_options import DOME, FLAT


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    kinds = parser.add_subparsers(dest='what', metavar='WHAT', required=True)

    stereo = kinds.add_parser('stereo', help='both cameras and their mutual pose, in air')
    _add_source(stereo)
    _add_live(stereo)
    _add_board(stereo)
    _add_output(stereo, Path('calibration'), 'calibration')
    stereo.add_argument(
        '--most-views', type=int, default=MOST_VIEWS, metavar='N', help='use at most N views'
    )
    stereo.add_argument(
        '--lens',
        choices=LENSES,
        default=AUTO,
        help='lens model: brown (five terms), rational (eight) or equidistant (four) for wide '
        'lenses; auto keeps five terms unless another predicts held-out views better '
        '(default: auto)',
    )
    stereo.add_argument(
        '--intrinsics',
        type=Path,
        metavar='DIR',
        help='folder of left.yaml and right.yaml: keep these cameras, or refine them within '
        'their covariance where that lies beside them, and find only their mutual pose',
    )
    stereo.add_argument(
        '--names',
        nargs=2,
        default=('left', 'right'),
        metavar=('LEFT', 'RIGHT'),
        help='camera names for the files',
    )

    camera = kinds.add_parser('camera', help='one camera alone, in air')
    add_camera_arguments(camera)
    _add_board(camera)
    _add_output(camera, Path('calibration'), 'calibration')

    interface = kinds.add_parser(
        'interface', help='the surface or the ports, from pictures through them'
    )
    _add_source(interface)
    _add_live(interface)
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
        '--side',
        choices=SIDES,
        help='SOURCE is a folder of the pictures of this camera alone: its port, or the surface '
        'as the left camera sees it',
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
        '--ports',
        action='store_true',
        help='a port for each camera: --indices and --thicknesses are theirs',
    )
    interface.add_argument(
        '--shape',
        choices=(FLAT, DOME),
        default=FLAT,
        help='of the ports: flat panes, or domes, whose centres are found (default: flat)',
    )
    interface.add_argument(
        '--radius', type=float, default=0.0, metavar='M', help='of the domes, inner (m)'
    )
    interface.add_argument(
        '--surface-indices',
        default='',
        metavar='N1,N2,..',
        help="with --ports: of a shared surface behind them (a tank's wall), beginning with the "
        'medium that the ports end in',
    )
    interface.add_argument(
        '--surface-thicknesses', default='', metavar='T,..', help='of the layers in it (m)'
    )
    interface.add_argument(
        '--prior',
        action='append',
        default=[],
        metavar='NAME=VALUE,SD',
        help='measured by hand: distance=0.80,0.005 (m), target_index=1.333,0.001, '
        'thicknesses.0=0.006,0.0002, normal=0,0,1,2 (direction and degrees), '
        'centre=0,0,0.002,0.001 and radius=0.05,0.0005 of domes, '
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
    add_topic_arguments(daily)
    add_remap_argument(daily)

    add_report_arguments(
        kinds.add_parser('report', help='how accurate the rig is, over its working volume')
    )
    add_convert_arguments(
        kinds.add_parser('convert', help='calibration files between ROS, kalibr and OpenCV')
    )
    for kind in kinds.choices.values():
        add_config_argument(kind)


def _add_source(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'source',
        type=Path,
        nargs='?',
        metavar='SOURCE',
        help='folder with left* and right* pictures or a sub-folder for each side, a list of '
        "pairs, a bag, a video, or the archive that ROS's calibrator saves",
    )
    for side in SIDES:
        parser.add_argument(
            f'--{side}',
            default='',
            metavar='DIR|TOPIC',
            help=f"the {side} camera's pictures: a folder, or a topic where SOURCE is a bag",
        )
    add_topic_arguments(parser, sides=False)
    add_remap_argument(parser)
    parser.add_argument(
        '--interval',
        type=float,
        default=0.5,
        metavar='S',
        help='from a bag or a video, take pairs at least this far apart (default: 0.5 s)',
    )
    parser.add_argument(
        '--layout',
        choices=LAYOUTS,
        help='each picture of the folder or video shows both views like this',
    )


def _add_board(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--board',
        default='9x6',
        metavar='COLUMNSxROWS',
        help='inner corners of a chessboard, squares of a ChArUco board, circles (default: 9x6)',
    )
    parser.add_argument('--square', type=float, metavar='M', help='side of a square (m)')
    parser.add_argument(
        '--kind',
        choices=KINDS,
        default=CHESSBOARD,
        metavar='KIND',
        help=f'kind of board: {", ".join(KINDS)} (default: chessboard)',
    )
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


def _add_live(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--live',
        action='store_true',
        help="take the views from the cameras' topics, with guidance in the terminal and on "
        'calibration/overlay/compressed, until they are good enough or Ctrl-C',
    )
    parser.add_argument(
        '--wanted',
        type=float,
        default=0.0005,
        metavar='M',
        help='live: good enough is a position to this standard deviation (default: 0.0005 m)',
    )
    parser.add_argument(
        '--distance',
        type=float,
        default=1.0,
        metavar='M',
        help='live: at this working distance (default: 1.0 m)',
    )
