"""`binopos simulate`: render a scene with known truth to a bag."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from binopos_ros.calibration.views.board import CHESSBOARD, KINDS, Board, parse_size
from binopos_ros.cli.config import add_config_argument, parameters_of
from binopos_ros.cli.progress import progress
from binopos_ros.cli.simulated_bag import record
from binopos_ros.node_options import NODES
from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.presets import PRESETS, Choices, in_air, with_board
from binopos_ros.simulation.rig_motion import MOTIONS, Odometer
from binopos_ros.simulation.target import PATHS

EPILOG = """\
examples:
  the paper's washbowl, 300 pairs; a still target under waves of 1 mm:
    binopos simulate -o bowl
    binopos simulate -o rough --waves 0.001 --still
  salt at the bottom of the bowl:
    binopos simulate -o brine --salt 1.37
  a robot's cameras behind glass ports, behind domes, and one which hovers:
    binopos simulate -o robot --preset ports
    binopos simulate -o wide --preset domes
    binopos simulate -o reef --preset ports --still --motion hover
  boards for calibrate stereo, and for calibrate interface:
    binopos simulate -o dry --board 9x6 --air --pairs 40 --rate 2
    binopos simulate -o wet --board 9x6 --pairs 15 --rate 2
  a rehearsal of calibrate stereo --live, which runs beside `binopos replay`:
    binopos simulate -o held --board 9x6 --air --rate 5 --hold 3 --pairs 300

The bag's folder also holds binopos.yaml (what the cameras look through, and
what --config and -p give), left.yaml and right.yaml (their calibration), so
that `binopos process BAG -o OUT.mcap` needs nothing else. The true position of
the target is on /stereo/truth/pose.
"""

FORMATS = {
    'jpeg': 'jpeg',
    'bgr8': 'bgr8',
    'rgb8': 'rgb8',
    'yuyv': 'yuv422_yuy2',
    'bayer': 'bayer_rggb8',
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        required=True,
        metavar='BAG',
        help='bag to write: a new folder, or a new file that ends in .mcap',
    )
    parser.add_argument(
        '--preset',
        choices=sorted(PRESETS),
        default='washbowl',
        help="washbowl: the paper's rig over a bowl of water, 1280x960; ports: two cameras behind "
        'flat glass under water, 1280x960; domes: two with wide lenses behind domes; demo: the '
        'washbowl at 640x480 (default: washbowl)',
    )
    parser.add_argument(
        '--pairs', type=int, metavar='N', help='pairs of pictures (default: 300, demo 150)'
    )
    parser.add_argument('--rate', type=float, metavar='HZ', help='pairs per second (default: 30)')
    parser.add_argument(
        '--seed',
        type=int,
        default=0,
        metavar='S',
        help='of textures, waves and noise; the same seed gives the same bag (default: 0)',
    )
    water = parser.add_argument_group('water')
    water.add_argument(
        '--waves',
        type=float,
        metavar='HEIGHT',
        help='waves: standard deviation of the surface height in m, as 0.0005 (default: calm)',
    )
    water.add_argument(
        '--wave-peak',
        type=float,
        metavar='HZ',
        help='frequency of the highest waves, from swell of 0.1 to ripples of 6 Hz (default: 2.5)',
    )
    water.add_argument(
        '--salt',
        type=float,
        metavar='INDEX',
        help='salt gradient: refractive index at the bottom, 1.333 .. 1.38, rising steadily from '
        '1.333 at the surface (default: fresh water)',
    )
    water.add_argument(
        '--air', action='store_true', help='nothing between cameras and target, for calibration'
    )
    target = parser.add_argument_group('target')
    motion = target.add_mutually_exclusive_group()
    motion.add_argument(
        '--path',
        choices=PATHS,
        metavar='PATH',
        help=f'how the target moves: {", ".join(PATHS)} (default: figure-eight)',
    )
    motion.add_argument(
        '--still', action='store_const', const='still', dest='path', help='same as --path still'
    )
    target.add_argument(
        '--period', type=float, metavar='S', help='seconds for one round of the path'
    )
    target.add_argument(
        '--swing',
        type=float,
        metavar='DEGREES',
        help='the rig swings to and fro by so much about its vertical axis (default: it hangs '
        'still); not before a water surface',
    )
    target.add_argument(
        '--swing-period', type=float, default=1.0, metavar='S', help='of that swing (default: 1)'
    )
    target.add_argument(
        '--diameter', type=float, metavar='M', help='diameter of the red disc in m'
    )
    target.add_argument(
        '--distractors', type=int, metavar='N', help='coloured things that are not the target'
    )
    robot = parser.add_argument_group('robot that carries the rig')
    robot.add_argument(
        '--motion',
        choices=MOTIONS,
        help='how it moves: hover by 7 cm and 5 degrees, along a survey line, or turning to and '
        'fro; its poses are on /stereo/platform/odometry, /tf and /tf_static, and the truth in '
        'the frame odom on /stereo/truth/fixed_pose (default: nothing moves)',
    )
    robot.add_argument(
        '--odometry-noise',
        type=float,
        nargs=2,
        metavar=('M', 'DEGREES'),
        help='standard deviations of its odometry along and about each axis (default: 0.002 0.1)',
    )
    robot.add_argument(
        '--odometry-rate', type=float, metavar='HZ', help='samples per second (default: 50)'
    )
    boards = parser.add_argument_group('calibration boards')
    boards.add_argument(
        '--board',
        metavar='COLSxROWS',
        help='show a calibration board instead of the disc, elsewhere in every pair: 9x6 inner '
        'corners of a chessboard, squares of a ChArUco board, circles of a grid',
    )
    boards.add_argument(
        '--hold',
        type=float,
        metavar='SECONDS',
        help='hold the board still at each place for so long, as one does before cameras for '
        '`binopos calibrate --live` (default: one pair)',
    )
    boards.add_argument(
        '--kind',
        choices=KINDS,
        default=CHESSBOARD,
        metavar='KIND',
        help=f'what is printed: {", ".join(KINDS)} (default: chessboard)',
    )
    boards.add_argument(
        '--square',
        type=float,
        default=0.02,
        metavar='M',
        help='side of a square in m (default: 0.02)',
    )
    boards.add_argument(
        '--marker',
        type=float,
        metavar='M',
        help='side of a ChArUco marker in m (default: 3/4 square)',
    )
    boards.add_argument(
        '--dictionary', default='DICT_4X4_50', metavar='NAME', help='of a ChArUco board'
    )
    camera = parser.add_argument_group('camera')
    camera.add_argument(
        '--noise',
        type=float,
        metavar='SIGMA',
        help='noise at mid grey, in grey levels of 255 (default: 1.5, demo 1.0)',
    )
    camera.add_argument(
        '--blur', type=float, metavar='PX', help="the lens's Gaussian blur in px (default: 0.6)"
    )
    camera.add_argument(
        '--format',
        choices=sorted(FORMATS),
        default='jpeg',
        help='encoding of the pictures: jpeg on image_raw/compressed, the others on image_raw '
        '(default: jpeg)',
    )
    camera.add_argument(
        '--quality', type=int, metavar='Q', help='of the JPEG, 1 .. 100 (default: 90, demo 70)'
    )
    parser.add_argument(
        '--threads',
        type=int,
        metavar='N',
        help='pictures rendered at once, without effect on the bag (default: one per processor)',
    )
    add_config_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    preset = PRESETS[arguments.preset]
    pairs = preset.pairs if arguments.pairs is None else arguments.pairs
    _refuse_contradictions(arguments)
    parameters = parameters_of(arguments)
    given = {name: values for name in NODES if (values := parameters.of_node(name))}
    board = _board(arguments)
    scene = preset.make(
        Choices(
            seed=arguments.seed,
            waves=arguments.waves,
            wave_peak=arguments.wave_peak,
            salt=arguments.salt,
            path=arguments.path,
            period=arguments.period,
            swing=None if arguments.swing is None else math.radians(arguments.swing),
            swing_period=arguments.swing_period,
            motion=arguments.motion,
            odometer=_odometer(arguments),
            diameter=arguments.diameter,
            distractors=arguments.distractors,
            noise=arguments.noise,
            quality=arguments.quality,
            blur=arguments.blur,
            encoding=FORMATS[arguments.format],
            rate=arguments.rate,
        )
    )
    if arguments.air:
        scene = in_air(scene, arguments.seed)
    if board:
        scene = with_board(scene, board, pairs, arguments.seed, arguments.hold or 0.0)
    with progress('rendering', pairs) as tick:
        record(
            scene,
            arguments.output,
            pairs,
            seed=arguments.seed,
            threads=arguments.threads,
            on_pair=tick,
            given=given,
        )
    print(
        f'{arguments.output}: {pairs} pairs, {pairs / scene.rate:.1f} s, '
        f'{_size(arguments.output)}; the truth is on /stereo/truth/pose'
    )
    return 0


def _refuse_contradictions(arguments: argparse.Namespace) -> None:
    if arguments.hold is not None:
        if not arguments.board:
            raise SimulationError('--hold is of a board: give --board too')
        if not 0.0 < arguments.hold < math.inf:
            raise SimulationError(f'--hold {arguments.hold:g}: give seconds above 0')
    for chosen, without in (
        ('board', ('path', 'period', 'diameter', 'swing', 'motion')),
        ('air', ('waves', 'wave_peak', 'salt')),
    ):
        for name in without if getattr(arguments, chosen) else ():
            if getattr(arguments, name) is not None:
                msg = f'--{chosen} has no {name.replace("_", " ")}: leave one of the two out'
                raise SimulationError(msg)


def _odometer(arguments: argparse.Namespace) -> Odometer:
    if arguments.motion is None:
        for name in ('odometry_noise', 'odometry_rate'):
            if getattr(arguments, name) is not None:
                msg = f'--{name.replace("_", "-")} is of a robot: give --motion too'
                raise SimulationError(msg)
    given = {}
    if arguments.odometry_noise is not None:
        given['position_std'] = arguments.odometry_noise[0]
        given['rotation_std'] = math.radians(arguments.odometry_noise[1])
    if arguments.odometry_rate is not None:
        given['rate'] = arguments.odometry_rate
    return Odometer(**given)


def _board(arguments: argparse.Namespace) -> Board | None:
    if arguments.board is None:
        return None
    columns, rows = parse_size(arguments.board)
    marker = 0.75 * arguments.square if arguments.marker is None else arguments.marker
    return Board(arguments.kind, columns, rows, arguments.square, marker, arguments.dictionary)


def _size(bag: Path) -> str:
    files = [bag] if bag.is_file() else [path for path in bag.iterdir() if path.is_file()]
    return f'{sum(path.stat().st_size for path in files) / 1e6:.1f} MB'
