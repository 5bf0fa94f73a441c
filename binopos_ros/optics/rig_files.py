"""A rig on its way to files: the pair of camera_infos, and an interface's block of parameters.

The rectification is Bouguet's as cv2.stereoRectify has it: both pictures turn by half, rows become
epipolar lines, and R and P carry the extrinsics (see `stereo_from_camera_infos`, which undoes it).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike

from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import Interface
from binopos_ros.optics.lens import BROWN

PLUMB_BOB_TERMS, RATIONAL_TERMS = 5, 8
#: Of R R^T from the identity: files hold six digits, and people round.
ROTATION_SLACK = 1e-2
#: How much of the pictures the rectified ones keep: no blank pixels; or, without a scale, all.
CROPPED, UNSCALED = 0.0, -1.0


def camera_infos_from_stereo(
    left: PinholeCamera,
    right: PinholeCamera,
    rotation: ArrayLike,
    translation: ArrayLike,
    names: tuple[str, str] = ('left', 'right'),
) -> tuple[CameraInfo, CameraInfo]:
    """Return the calibration in air of both cameras, with the extrinsics in R and P.

    Args:
        left: the left camera.
        right: the right camera.
        rotation: (3, 3) and
        translation: (3,) m, so that x_right = rotation @ x_left + translation.
        names: of the cameras.

    Raises:
        OpticsError: the two pictures differ in size, which no rectification allows.

    """
    if tuple(left.size) != tuple(right.size):
        msg = (
            f'the left pictures are {left.size[0]}x{left.size[1]} px, the right ones'
            f' {right.size[0]}x{right.size[1]}: set both cameras to one resolution'
        )
        raise OpticsError(msg)

    def rectified(alpha: float) -> tuple[Any, ...]:
        found: Any = cv2.stereoRectify(
            np.asarray(left.matrix),
            _rectifiable(left),
            np.asarray(right.matrix),
            _rectifiable(right),
            (int(left.size[0]), int(left.size[1])),
            np.asarray(rotation, float),
            np.asarray(translation, float).reshape(3, 1),
            flags=cv2.CALIB_ZERO_DISPARITY,
            alpha=alpha,
        )
        return tuple(found[:4])

    turn_left, turn_right, p_left, p_right = rectified(CROPPED)
    if not (np.isfinite(p_left).all() and p_left[0, 0] > 0.0):
        # A lens that folds near the pictures' edges leaves no rectangle without blank pixels.
        turn_left, turn_right, p_left, p_right = rectified(UNSCALED)
    return (
        _camera_info(names[0], left, turn_left, p_left),
        _camera_info(names[1], right, turn_right, p_right),
    )


def camera_info_alone(camera: PinholeCamera, name: str) -> CameraInfo:
    """Return the calibration of a camera that belongs to no rig: nothing to rectify."""
    projection = np.column_stack([camera.matrix, np.zeros(3)])
    return _camera_info(name, camera, np.eye(3), projection)


def camera_infos_from_parts(
    left: CameraInfo, right: CameraInfo, rotation: ArrayLike, translation: ArrayLike
) -> tuple[CameraInfo, CameraInfo]:
    """Put the extrinsics into R and P of two calibrations that have none.

    Args:
        left: of the left camera.
        right: of the right one.
        rotation: (3, 3) and
        translation: (3,) m, so that x_right = rotation @ x_left + translation.

    Raises:
        OpticsError: a camera is impossible, or the rotation is none.

    """
    turn = np.asarray(rotation, float)
    if np.abs(turn @ turn.T - np.eye(3)).max() > ROTATION_SLACK or np.linalg.det(turn) < 0:
        msg = f'the rotation from {left.name!r} to {right.name!r} is none: {turn.ravel().tolist()}'
        raise OpticsError(msg)
    return camera_infos_from_stereo(
        left.camera(), right.camera(), turn, translation, (left.name, right.name)
    )


def interface_block(
    place: str, interface: Interface, remarks: Mapping[str, str] | None = None
) -> list[str]:
    """Return an interface's lines in the triangulator's block of a ROS 2 parameter file.

    Args:
        place: 'interface', 'left_port' or 'right_port'.
        interface: what stands there.
        remarks: comments on values, by name.

    """
    said = remarks or {}
    return [
        f'    {place}:',
        *(
            f'      {name}: {_yaml(value)}' + (f'  # {said[name]}' if said.get(name) else '')
            for name, value in interface.written.items()
        ),
    ]


def _yaml(value: str | float | Sequence[float]) -> str:
    if isinstance(value, str):
        return value
    return repr(float(value)) if isinstance(value, float) else yaml_numbers(value)


def yaml_numbers(values: ArrayLike) -> str:
    """Return numbers as a YAML list that reads back to the last bit."""
    return f'[{", ".join(repr(float(value)) for value in np.ravel(values))}]'


def _camera_info(
    name: str, camera: PinholeCamera, turn: np.ndarray, projection: np.ndarray
) -> CameraInfo:
    model, terms = _lens(camera)
    return CameraInfo(
        name=name,
        width=int(camera.size[0]),
        height=int(camera.size[1]),
        distortion_model=model,
        d=tuple(map(float, terms)),
        k=tuple(map(float, np.ravel(camera.matrix))),
        r=tuple(map(float, turn.ravel())),
        p=tuple(map(float, projection.ravel())),
    )


def _rectifiable(camera: PinholeCamera) -> np.ndarray:
    """The terms that cv2.stereoRectify takes. The rotations do not depend on them; of a lens that
    it does not know, the rectified pictures keep the scale of the middle."""
    return _lens(camera)[1] if camera.model == BROWN else np.zeros(PLUMB_BOB_TERMS)


def _lens(camera: PinholeCamera) -> tuple[str, np.ndarray]:
    """ROS's name of the lens model, and its terms: plumb_bob has 5, rational_polynomial 8."""
    given = np.asarray(camera.distortion, float).ravel()
    if camera.model != BROWN:
        return camera.model, given
    fewest = PLUMB_BOB_TERMS if given.size <= PLUMB_BOB_TERMS else RATIONAL_TERMS
    terms = np.zeros(max(fewest, given.size))
    terms[: given.size] = given
    return 'plumb_bob' if terms.size == PLUMB_BOB_TERMS else 'rational_polynomial', terms
