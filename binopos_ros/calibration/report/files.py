"""The calibration's files: two camera_info YAMLs, the interface's parameters, the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from binopos_ros.calibration.cameras.alone import CameraCalibration
from binopos_ros.calibration.cameras.given import GivenCameras
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import InterfaceCalibration
from binopos_ros.optics import (
    CameraInfo,
    read_camera_info,
    stereo_from_camera_infos,
    write_camera_info,
)
from binopos_ros.optics.covariance_file import (
    ParameterCovariance,
    read_covariance,
    write_covariance,
)
from binopos_ros.optics.rig_files import (
    camera_info_alone,
    camera_infos_from_stereo,
    interface_block,
)
from binopos_ros.optics.rig_state import TARGET_INDEX, Camera, RigState
from binopos_ros.sides import SIDES

INTERFACE_FILE = 'interface.yaml'
COVARIANCE_FILE = 'covariance.yaml'
INTERFACE_HEAD = (
    '# What the cameras look through; a ROS 2 parameter file for --config and --params-file.',
    '# Written by `binopos calibrate interface`. +- is one standard deviation.',
    '/**/triangulator:',
    '  ros__parameters:',
)
#: Of what the triangulator takes a deviation where it has no covariance.
STATED = ('normal', 'distance', 'centre')


def camera_infos(state: RigState, names: tuple[str, str] = SIDES) -> tuple[CameraInfo, CameraInfo]:
    """The rig as ROS's calibration messages, rectification included.

    Raises:
        OpticsError: the two pictures differ in size, which no rectification allows.
    """
    left, right = (camera.pinhole() for camera in state.cameras)
    return camera_infos_from_stereo(left, right, state.rotation, state.translation, names)


def write_stereo(
    folder: Path,
    state: RigState,
    covariance: np.ndarray,
    names: tuple[str, str] = SIDES,
) -> list[Path]:
    """Write left.yaml, right.yaml and covariance.yaml; the paths, in this order."""
    _make_folder(folder)
    paths = []
    for side, info in zip(SIDES, camera_infos(state, names), strict=True):
        path = folder / f'{side}.yaml'
        write_camera_info(path, info)
        paths.append(path)
    path = folder / COVARIANCE_FILE
    write_covariance(path, state, covariance)
    return [*paths, path]


def write_camera(folder: Path, side: str, calibration: CameraCalibration) -> list[Path]:
    """Write SIDE.yaml and SIDE_covariance.yaml of a camera alone; the paths, in this order."""
    return write_one(folder, side, calibration.adjustment.state, calibration.adjustment.covariance)


def write_one(folder: Path, side: str, state: RigState, covariance: np.ndarray) -> list[Path]:
    """Write SIDE.yaml and SIDE_covariance.yaml of a rig's only camera; the paths."""
    _make_folder(folder)
    paths = [folder / f'{side}.yaml', folder / f'{side}_{COVARIANCE_FILE}']
    write_camera_info(paths[0], camera_info_alone(state.cameras[0].pinhole(), side))
    write_covariance(paths[1], state, covariance)
    return paths


def write_interface(folder: Path, calibration: InterfaceCalibration) -> list[Path]:
    """Write interface.yaml, the triangulator's parameters, and the stereo files beside it.

    The pictures through the interface have improved the cameras a little, too, and the covariance
    is that of all of them together: the four files belong together.
    """
    lines = list(INTERFACE_HEAD)
    lines.append(f'    calibration_covariance: {COVARIANCE_FILE}  # beside this file')
    for place, interface in calibration.state.interfaces.items():
        lines += interface_block(place, interface, _remarks(calibration, place))
    paths = write_stereo(folder, calibration.state, calibration.covariance)
    path = folder / INTERFACE_FILE
    write_text(path, '\n'.join(lines) + '\n')
    return [path, *paths]


def write_interface_alone(
    folder: Path, side: str, calibration: InterfaceCalibration
) -> list[Path]:
    """Write what one camera looks through, SIDE_interface.yaml, and its own two files beside it.

    The triangulator takes the files of both sides together. Its covariance is of a whole rig, so
    here the deviations are stated one by one.
    """
    lines = list(INTERFACE_HEAD)
    for place, interface in calibration.state.interfaces.items():
        lines += interface_block(place, interface, _remarks(calibration, place))
        for kind, spread in _spreads(calibration, place).items():
            if kind in STATED:
                lines.append(f'      {kind}_std: {max(spread)!r}')
    state = calibration.state
    paths = write_one(folder, side, state, calibration.covariance)
    path = folder / f'{side}_{INTERFACE_FILE}'
    write_text(path, '\n'.join(lines) + '\n')
    return [path, *paths]


def _remarks(calibration: InterfaceCalibration, place: str) -> dict[str, str]:
    """Units and standard deviations of an interface's values, by their names in the file."""
    interface = calibration.state.interfaces[place]
    spreads = _spreads(calibration, place)
    remarks = {
        kind: 'm, +- ' + ', '.join(f'{one:.5f}' for one in spread)
        for kind, spread in spreads.items()
        if kind not in ('normal', 'indices')
    }
    if 'normal' in spreads:
        remarks['normal'] = f'+- {np.degrees(max(spreads["normal"])):.3f} deg'
    if 'distance' in spreads and interface.indices[0] == interface.indices[-1]:
        remarks['distance'] = 'm, of a plate: it does not matter'
    elif place in calibration.state.last_places:
        remarks['indices'] = f'the last +- {calibration.deviation(TARGET_INDEX):.5f}'
    return remarks


def _spreads(calibration: InterfaceCalibration, place: str) -> dict[str, list[float]]:
    """The standard deviations of an interface's parameters by kind."""
    spreads: dict[str, list[float]] = {}
    for name in calibration.state.names_of(place):
        spreads.setdefault(name.split('.')[1], []).append(calibration.deviation(name))
    return spreads


def read_stereo(folder: Path) -> tuple[RigState, ParameterCovariance | None]:
    """Read left.yaml and right.yaml of a folder, and covariance.yaml where it is there.

    Raises:
        CalibrationError: a file is missing. OpticsError: it cannot be used.
    """
    _refuse_missing(folder)
    infos = [read_camera_info(folder / f'{side}.yaml') for side in SIDES]
    left, right, rotation, translation = stereo_from_camera_infos(*infos)
    state = RigState((Camera.of(left), Camera.of(right)), rotation, translation)
    path = folder / COVARIANCE_FILE
    return state, read_covariance(path) if path.is_file() else None


def read_intrinsics(folder: Path) -> GivenCameras:
    """Read the cameras of a folder alone, whatever their mutual pose.

    Their covariance is that of a stereo calibration, or of each camera's own.

    Raises:
        CalibrationError: a file is missing. OpticsError: it cannot be used.
    """
    _refuse_missing(folder, 'or `calibrate camera` for each side ')
    left, right = (Camera.of(read_camera_info(folder / f'{side}.yaml').camera()) for side in SIDES)
    path = folder / COVARIANCE_FILE
    if path.is_file():
        return GivenCameras((left, right), read_covariance(path))
    own = [folder / f'{side}_{COVARIANCE_FILE}' for side in SIDES]
    if not all(one.is_file() for one in own):
        return GivenCameras((left, right))
    first, second = (read_covariance(one) for one in own)
    count = len(first.names)
    matrix = np.zeros((count + len(second.names),) * 2)
    matrix[:count, :count], matrix[count:, count:] = first.matrix, second.matrix
    # A camera alone is its rig's first.
    names = [name.replace(f'{SIDES[0]}.', f'{SIDES[1]}.') for name in second.names]
    return GivenCameras((left, right), ParameterCovariance((*first.names, *names), matrix))


def read_one(folder: Path, side: str) -> tuple[RigState, ParameterCovariance | None]:
    """Read one camera of a folder as a rig's only one, and the covariance of its parameters.

    Raises:
        CalibrationError: a file is missing. OpticsError: it cannot be used.
    """
    _refuse_missing(folder, f'or `calibrate camera --side {side}` ', (side,))
    state = RigState((Camera.of(read_camera_info(folder / f'{side}.yaml').camera()),))
    own, of_both = folder / f'{side}_{COVARIANCE_FILE}', folder / COVARIANCE_FILE
    if own.is_file():
        return state, read_covariance(own)
    if not of_both.is_file():
        return state, None
    # A camera alone is its rig's first.
    names = [name.replace(f'{SIDES[0]}.', f'{side}.') for name in state.names]
    return state, ParameterCovariance(state.names, read_covariance(of_both).ordered(names))


def _refuse_missing(folder: Path, otherwise: str = '', sides: Sequence[str] = SIDES) -> None:
    for side in sides:
        if not (folder / f'{side}.yaml').is_file():
            raise CalibrationError(
                f'{folder} holds no {side}.yaml: give the folder that `binopos calibrate stereo` '
                f'{otherwise}has written'
            )


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f'cannot make the folder {folder}: {error.strerror}'
        raise CalibrationError(msg) from None


def write_text(path: Path, text: str) -> None:
    """Write a file, or say in one line why not."""
    try:
        path.write_text(text, encoding='utf-8')
    except OSError as error:
        msg = f'cannot write {path}: {error.strerror}'
        raise CalibrationError(msg) from None
