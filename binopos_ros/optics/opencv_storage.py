"""Stereo calibrations in OpenCV's FileStorage, as its samples and most scripts write them.

Both cameras under numbered keys (M1, D1, M2, D2 and what others call them), with R and T from
`cv2.stereoCalibrate`: x_right = R x_left + T. The sample writes two files, intrinsics and
extrinsics, of which neither has the pictures' size.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from binopos_ros.optics.camera_info import CameraInfo, lens_model, stereo_from_camera_infos
from binopos_ros.optics.camera_info_fields import is_fisheye, numbers, whole
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.lens import EQUIDISTANT
from binopos_ros.optics.rig_files import camera_infos_from_parts
from binopos_ros.sides import SIDES

PathLike = str | os.PathLike[str]
MATRICES = ('M{}', 'K{}', 'cameraMatrix{}', 'camera_matrix_{}', 'camera_matrix{}', 'mtx{}')
LENSES = ('D{}', 'distCoeffs{}', 'dist_coeffs_{}', 'distortion_coefficients{}', 'dist{}')
ROTATIONS, TRANSLATIONS = ('R', 'rotation_matrix'), ('T', 'translation_vector', 't')
WIDTHS, HEIGHTS = ('image_width', 'width'), ('image_height', 'height')
SIZES = ('image_size', 'imageSize', 'size')
SUFFIXES = ('.yml', '.yaml', '.xml')
#: What the cameras' keys end in, with numbers and with the sides' names.
NUMBERED, NAMED = ('1', '2'), ('_left', '_right')


def is_opencv_stereo(data: Mapping[str, Any]) -> bool:
    """Tell whether the keys are those of a pair, or of a part of one."""
    return _found(data, MATRICES, '1') is not None or (
        _found(data, ROTATIONS) is not None and _found(data, TRANSLATIONS) is not None
    )


def cameras_of_opencv(
    data: Mapping[str, Any], path: PathLike, size: tuple[int, int] | None = None
) -> list[CameraInfo]:
    """The cameras of a pair in FileStorage.

    Args:
        data: what the file, or the two files together, say.
        path: to be told.
        size: of the pictures, px, where the file has none.

    Raises:
        OpticsError: something is missing or impossible.
    """
    size = size or _size(data, path)
    if size is None:
        msg = (
            f'{path} is FileStorage of OpenCV without the size of the pictures: convert it with '
            '"binopos calibrate convert --size WIDTHxHEIGHT"'
        )
        raise OpticsError(msg)
    parts = []
    for side, number in zip(SIDES, NUMBERED, strict=True):
        matrix, lens = _found(data, MATRICES, number), _found(data, LENSES, number)
        if matrix is None or lens is None:
            msg = (
                f'{path} is FileStorage of OpenCV without M{number} and D{number}: give the file '
                'of the intrinsics too ("binopos calibrate convert INTRINSICS EXTRINSICS")'
            )
            raise OpticsError(msg)
        terms = numbers(data, lens, None, path)
        model = lens_model('fisheye' if is_fisheye(data) else '', len(terms))
        parts.append(
            CameraInfo(
                name=side,
                width=size[0],
                height=size[1],
                distortion_model=model,
                d=terms,
                k=numbers(data, matrix, 9, path),
            )
        )
    rotation, translation = _found(data, ROTATIONS), _found(data, TRANSLATIONS)
    if rotation is None or translation is None:
        msg = (
            f'{path} is FileStorage of OpenCV without R and T: give the file of the extrinsics '
            'too ("binopos calibrate convert INTRINSICS EXTRINSICS")'
        )
        raise OpticsError(msg)
    turn = np.array(numbers(data, rotation, None, path))
    if turn.size == 3:
        turn = np.asarray(cv2.Rodrigues(turn)[0])
    if turn.size != 9:
        raise OpticsError(f'{path}: {rotation} must hold 9 numbers (or 3), not {turn.size}')
    step = np.array(numbers(data, translation, 3, path))
    return list(camera_infos_from_parts(parts[0], parts[1], turn.reshape(3, 3), step))


def write_opencv(path: PathLike, left: CameraInfo, right: CameraInfo) -> None:
    """Write a pair as FileStorage, YAML or XML by the name: M1, D1, M2, D2, R, T, R1 .. P2.

    Raises:
        OpticsError: the two make no rig, have different lenses, or the file cannot be written.
    """
    if (left.distortion_model == EQUIDISTANT) != (right.distortion_model == EQUIDISTANT):
        raise OpticsError('OpenCV has one lens model for both cameras: these have two')
    _, _, rotation, translation = stereo_from_camera_infos(left, right)
    if Path(path).suffix not in SUFFIXES:
        raise OpticsError(f'{path}: FileStorage of OpenCV is a file {", ".join(SUFFIXES)}')
    try:
        # OpenCV prints of its own what it cannot open.
        Path(path).touch()
    except OSError as error:
        raise OpticsError(f'cannot write {path}: {error.strerror}') from None
    storage = cv2.FileStorage(os.fspath(path), cv2.FILE_STORAGE_WRITE)
    storage.write('image_width', left.width)
    storage.write('image_height', left.height)
    storage.write('fisheye_model', int(left.distortion_model == EQUIDISTANT))
    for number, info in zip(NUMBERED, (left, right), strict=True):
        storage.write(f'M{number}', np.reshape(info.k, (3, 3)))
        storage.write(f'D{number}', np.reshape(info.d, (1, -1)))
    storage.write('R', rotation)
    storage.write('T', translation.reshape(3, 1))
    for number, info in zip(NUMBERED, (left, right), strict=True):
        storage.write(f'R{number}', np.reshape(info.r, (3, 3)))
        storage.write(f'P{number}', np.reshape(info.p, (3, 4)))
    storage.release()


def _found(data: Mapping[str, Any], names: tuple[str, ...], number: str = '') -> str | None:
    """The key among `names` that is there; sides may be numbered or named."""
    endings = (number, NAMED[NUMBERED.index(number)]) if number else ('',)
    for name in names:
        for ending in endings:
            key = name.format(ending).replace('__', '_')
            if key in data:
                return key
    return None


def _size(data: Mapping[str, Any], path: PathLike) -> tuple[int, int] | None:
    width, height = _found(data, WIDTHS), _found(data, HEIGHTS)
    if width is not None and height is not None:
        return whole(data, width, path), whole(data, height, path)
    key = _found(data, SIZES)
    if key is None:
        return None
    pair = dict(zip(('width', 'height'), numbers(data, key, 2, path), strict=True))
    return whole(pair, 'width', path), whole(pair, 'height', path)
