"""The layers of parameters that a verb works with: the bag's own, `--config`, `--ros-args`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from binopos_ros.bag.rig_topics import NAMESPACE
from binopos_ros.node_options import Parameters
from binopos_ros.optics import CameraInfo, stereo_from_camera_infos
from binopos_ros.optics.camera_info_files import read_pair
from binopos_ros.parameters import ParameterError
from binopos_ros.sides import SIDES

BAG_CONFIG = 'binopos.yaml'


def add_config_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--config FILE`, which every verb takes."""
    parser.add_argument(
        '--config',
        type=Path,
        metavar='FILE',
        help="ROS 2 parameter file of the nodes; it goes over the binopos.yaml of a bag's folder",
    )


def add_calibration_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--calibration DIR`, for verbs that process a bag."""
    parser.add_argument(
        '--calibration',
        type=Path,
        metavar='DIR|FILE',
        help='folder with left.yaml and right.yaml, or a file with both cameras (kalibr, OpenCV, '
        "ost.txt), in the place of the bag's camera_info",
    )


def calibration_of(arguments: argparse.Namespace) -> dict[str, CameraInfo]:
    """The cameras' calibrations out of `--calibration DIR`, by side; empty without it.

    Raises:
        OpticsError: a file cannot be read.
    """
    given = arguments.calibration
    if given is None:
        return {}
    return calibration_in(*([given] if given.is_file() else (given / f'{s}.yaml' for s in SIDES)))


def calibration_in(*paths: Path) -> dict[str, CameraInfo]:
    """The calibrations in a file of both cameras, or in two files, by side.

    Raises:
        OpticsError: a file cannot be read, or the two make no rig.
    """
    found = read_pair(paths)
    # What does not make a rig is refused before anything is played.
    stereo_from_camera_infos(*found)
    for line in (line for info in found for line in info.contradictions()):
        print(f'binopos: {line}', file=sys.stderr)
    return dict(zip(SIDES, found, strict=True))


def calibration_beside(bag: Path) -> tuple[()] | tuple[Path, Path]:
    """The calibration files of a bag, named as its parameter file is; () where one is missing."""
    left, right = (_beside(bag, f'{side}.yaml') for side in SIDES)
    return () if left is None or right is None else (left, right)


def told_sources(arguments: argparse.Namespace, parameters: Parameters) -> list[str]:
    """What a report says of the layers that were used, the calibration among them."""
    given = arguments.calibration
    return [*parameters.sources, *([f'--calibration {given}'] if given is not None else [])]


def layers(arguments: argparse.Namespace, bag: Path | None = None) -> list[Path]:
    """The parameter files of a verb, the later over the earlier: the bag's own, `--config`.

    Raises:
        ParameterError: the file that was given does not exist.
    """
    files = []
    if bag is not None and (own := config_of_bag(bag)) is not None:
        files.append(own)
    if arguments.config is not None:
        if not arguments.config.is_file():
            msg = f'{arguments.config}: there is no such parameter file; check the path'
            raise ParameterError(msg)
        files.append(arguments.config)
    return files


def ros_words(files: Sequence[Path], arguments: Sequence[str]) -> list[str]:
    """The layers as words after `--ros-args`, for nodes."""
    return [word for path in files for word in ('--params-file', str(path))] + list(arguments)


def config_of_bag(bag: Path) -> Path | None:
    """The parameter file in a bag's folder; beside a single file NAME.mcap, NAME.binopos.yaml."""
    return _beside(bag, BAG_CONFIG)


def _beside(bag: Path, name: str) -> Path | None:
    paths = [bag / name]
    if not bag.is_dir():
        paths = [bag.parent / f'{bag.stem}.{name}', bag.parent / name]
    return next((path for path in paths if path.is_file()), None)


def parameters_of(
    arguments: argparse.Namespace, bag: Path | None = None, namespace: str = NAMESPACE
) -> Parameters:
    """The parameters of a verb without ROS, out of all layers.

    Raises:
        ParameterError: a file or a word cannot be read, or a word is none of a parameter.
    """
    parameters = live_parameters(arguments, bag, namespace)
    if parameters.others:
        msg = f'--ros-args {parameters.others[0]}: only -p and --params-file work offline'
        raise ParameterError(msg)
    return parameters


def live_parameters(
    arguments: argparse.Namespace, bag: Path | None = None, namespace: str = NAMESPACE
) -> Parameters:
    """As `parameters_of`, for a verb that starts nodes; blocks that hold for nothing are told.

    Raises:
        ParameterError: a file or a word cannot be read.
    """
    parameters = Parameters(layers(arguments, bag), arguments.ros_arguments, namespace)
    for notice in parameters.notices():
        print(f'binopos {arguments.verb}: {notice}', file=sys.stderr)
    return parameters
