"""The calibration's files: two camera_info YAMLs, the interface's parameters, the covariance.

The rectification is Bouguet's as cv2.stereoRectify has it: both pictures turn by half, rows
become epipolar lines, and R and P carry the extrinsics (see `optics.stereo_from_camera_infos`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from binopos_ros.calibration.covariance import (
    ParameterCovariance,
    read_covariance,
    write_covariance,
)
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface import InterfaceCalibration
from binopos_ros.calibration.state import LEFT, RIGHT, SIDES, TARGET_INDEX, Camera, RigState
from binopos_ros.optics import (
    CameraInfo,
    read_camera_info,
    stereo_from_camera_infos,
    write_camera_info,
)

INTERFACE_FILE = 'interface.yaml'
COVARIANCE_FILE = 'covariance.yaml'
PLUMB_BOB, RATIONAL = 'plumb_bob', 'rational_polynomial'


def camera_infos(state: RigState, names: tuple[str, str] = SIDES) -> tuple[CameraInfo, CameraInfo]:
    """The rig as ROS's calibration messages, rectification included.

    Raises:
        CalibrationError: the two pictures differ in size, which no rectification allows.
    """
    left, right = state.cameras
    if left.size != right.size:
        raise CalibrationError(
            f'the left pictures are {left.size[0]}x{left.size[1]} px, the right ones '
            f'{right.size[0]}x{right.size[1]}: set both cameras to one resolution'
        )
    rotations_and_projections: Any = cv2.stereoRectify(
        left.matrix,
        _lens(left),
        right.matrix,
        _lens(right),
        left.size,
        state.rotation,
        state.translation.reshape(3, 1),
        flags=cv2.CALIB_ZERO_DISPARITY,
        alpha=0.0,
    )
    r_left, r_right, p_left, p_right = rotations_and_projections[:4]
    return (
        _info(names[LEFT], left, r_left, p_left),
        _info(names[RIGHT], right, r_right, p_right),
    )


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


def _lens(camera: Camera) -> np.ndarray:
    return camera.lens if len(camera.lens) else np.zeros(5)


def _info(name: str, camera: Camera, rectify: np.ndarray, project: np.ndarray) -> CameraInfo:
    lens = _lens(camera)
    return CameraInfo(
        name=name,
        width=camera.size[0],
        height=camera.size[1],
        distortion_model=PLUMB_BOB if len(lens) <= 5 else RATIONAL,
        d=tuple(map(float, lens)),
        k=tuple(map(float, camera.matrix.ravel())),
        r=tuple(map(float, np.asarray(rectify).ravel())),
        p=tuple(map(float, np.asarray(project).ravel())),
    )


def write_interface(folder: Path, calibration: InterfaceCalibration) -> list[Path]:
    """Write interface.yaml, the triangulator's parameters, and the stereo files beside it.

    The pictures through the interface have improved the cameras a little, too, and the covariance
    is that of all of them together: the four files belong together.
    """
    lines = [
        '# What the cameras look through; a ROS 2 parameter file for --config and --params-file.',
        '# Written by `binopos calibrate interface`. +- is one standard deviation.',
        '/**/triangulator:',
        '  ros__parameters:',
    ]
    index = calibration.deviation(TARGET_INDEX)
    for place, interface in calibration.state.interfaces.items():
        tilt = [calibration.deviation(f'{place}.normal.{i}') for i in (0, 1)]
        distance = calibration.deviation(f'{place}.distance')
        last = f'  # the last +- {index:.5f}' if place in calibration.state.last_places else ''
        lines += [
            f'    {place}:',
            f'      normal: {_numbers(interface.normal)}  # +- {np.degrees(max(tilt)):.3f} deg',
            f'      distance: {interface.distance!r}  # m, +- {distance:.5f}',
            f'      indices: {_numbers(interface.indices)}{last}',
        ]
        if interface.thicknesses:
            spread = ', '.join(
                f'{calibration.deviation(f"{place}.thicknesses.{i}"):.5f}'
                for i in range(len(interface.thicknesses))
            )
            lines += [f'      thicknesses: {_numbers(interface.thicknesses)}  # m, +- {spread}']
    paths = write_stereo(folder, calibration.state, calibration.covariance)
    path = folder / INTERFACE_FILE
    write_text(path, '\n'.join(lines) + '\n')
    return [path, *paths]


def read_stereo(folder: Path) -> tuple[RigState, ParameterCovariance | None]:
    """Read left.yaml and right.yaml of a folder, and covariance.yaml where it is there.

    Raises:
        CalibrationError: a file is missing. OpticsError: it cannot be used.
    """
    for side in SIDES:
        if not (folder / f'{side}.yaml').is_file():
            raise CalibrationError(
                f'{folder} holds no {side}.yaml: give the folder that `binopos calibrate stereo` '
                'has written'
            )
    infos = [read_camera_info(folder / f'{side}.yaml') for side in SIDES]
    left, right, rotation, translation = stereo_from_camera_infos(*infos)
    state = RigState((Camera.of(left), Camera.of(right)), rotation, translation)
    path = folder / COVARIANCE_FILE
    return state, read_covariance(path) if path.is_file() else None


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


def _numbers(values: ArrayLike) -> str:
    return f'[{", ".join(repr(float(value)) for value in np.ravel(values))}]'
