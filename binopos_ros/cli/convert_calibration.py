"""`binopos calibrate convert`: a pair's calibration from one program's files to another's."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.cli.outputs import add_force_argument, written
from binopos_ros.optics import CameraInfo, stereo_from_camera_infos, write_camera_info
from binopos_ros.optics.camera_info_files import read_pair
from binopos_ros.optics.kalibr import write_kalibr
from binopos_ros.optics.opencv_storage import write_opencv
from binopos_ros.sides import SIDES

ROS, KALIBR, OPENCV = FORMATS = ('ros', 'kalibr', 'opencv')
#: Metres of what OpenCV's T and ROS's P were written in.
UNITS = {'m': 1.0, 'cm': 0.01, 'mm': 0.001}


def add_convert_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `calibrate convert`."""
    parser.add_argument(
        'sources',
        nargs='+',
        type=Path,
        metavar='SOURCE',
        help="a file with both cameras (kalibr's camchain.yaml, FileStorage of OpenCV, ROS's "
        "ost.txt), those of the left and of the right one, OpenCV's intrinsics and extrinsics, or "
        'a folder of left.yaml and right.yaml',
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        required=True,
        metavar='DIR|FILE',
        help='of ros a folder, of the others a file; OpenCV writes XML where its name ends so',
    )
    parser.add_argument(
        '--to', choices=FORMATS, default=ROS, help='what to write (default: %(default)s)'
    )
    parser.add_argument(
        '--size', metavar='WxH', help="the pictures' size in pixels, where no file says it"
    )
    parser.add_argument(
        '--unit', choices=UNITS, default='m', help='of the baseline in SOURCE (default: m)'
    )
    add_force_argument(parser)


def convert(arguments: argparse.Namespace) -> int:
    """Read one program's files, check the rig that they make, write another's.

    Raises:
        CalibrationError, OpticsError: there are not two cameras, or they make no rig.
    """
    size = parse_pixels(arguments.size) if arguments.size else None
    infos = read_pair(_files_of(arguments.sources), size)
    left, right = (_in_metres(info, UNITS[arguments.unit]) for info in infos)
    # What does not make a rig is refused before anything is written.
    stereo_from_camera_infos(left, right)
    for line in (*left.contradictions(), *right.contradictions()):
        print(line)
    for path in _write(arguments, left, right):
        print(f'written: {path}')
    return 0


def parse_pixels(text: str) -> tuple[int, int]:
    """'640x480' -> (640, 480).

    Raises:
        CalibrationError: where the text is not two whole numbers with an x in between.
    """
    words = text.lower().split('x')
    if len(words) != 2 or not all(word.strip().isdecimal() for word in words):
        raise CalibrationError(f'--size {text!r}: write width x height in pixels, as 640x480')
    return int(words[0]), int(words[1])


def _files_of(sources: Sequence[Path]) -> list[Path]:
    """The files; those of a folder by the sides' names."""
    if len(sources) == 1 and sources[0].is_dir():
        return [sources[0] / f'{side}.yaml' for side in SIDES]
    return list(sources)


def _in_metres(info: CameraInfo, unit: float) -> CameraInfo:
    p = list(info.p)
    p[3], p[7] = unit * p[3], unit * p[7]
    return replace(info, p=tuple(p))


def _write(arguments: argparse.Namespace, left: CameraInfo, right: CameraInfo) -> list[Path]:
    output: Path = arguments.output
    if arguments.to != ROS:
        write = write_kalibr if arguments.to == KALIBR else write_opencv
        with written(output, arguments.force) as path:
            write(path, left, right)
        return [output]
    output.mkdir(parents=True, exist_ok=True)
    made = [output / f'{side}.yaml' for side in SIDES]
    for path, info in zip(made, (left, right), strict=True):
        with written(path, arguments.force) as part:
            write_camera_info(part, info)
    return made
