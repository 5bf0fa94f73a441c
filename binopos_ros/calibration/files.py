"""The calibration's files: two camera_info YAMLs, and the covariance beside them.

The rectification is Bouguet's as cv2.stereoRectify has it: both pictures turn by half, rows
become epipolar lines, and R and P carry the extrinsics (see `optics.stereo_from_camera_infos`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from binopos_ros.calibration.covariance import write_covariance
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.state import LEFT, RIGHT, SIDES, Camera, RigState
from binopos_ros.optics import CameraInfo, write_camera_info

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
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        msg = f'cannot make the folder {folder}: {error.strerror}'
        raise CalibrationError(msg) from None
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
