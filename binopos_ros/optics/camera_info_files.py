"""Calibration files: ROS's camera_info YAML, and what others write.

The YAML has the keys and the order of camera_calibration_parsers; numbers are written so that they
read back to the last bit.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from typing import Any

import yaml

from binopos_ros.optics.calibration_text import mapping_of, text_of, write_lines
from binopos_ros.optics.camera_info import CameraInfo, CameraInfoWarning, Roi
from binopos_ros.optics.camera_info_fields import (
    camera_info_of,
    camera_info_of_message,
    is_message,
)
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.kalibr import cameras_of_kalibr, is_kalibr
from binopos_ros.optics.opencv_storage import cameras_of_opencv, is_opencv_stereo
from binopos_ros.optics.ost import cameras_of_ost, is_ost

PathLike = str | os.PathLike[str]


def read_camera_info(path: PathLike, camera: str | None = None) -> CameraInfo:
    """Read one camera's calibration: ROS's YAML, oST text, kalibr, FileStorage, a printed message.

    Args:
        path: the file.
        camera: which one, where a file holds several: its name, or the last part of it.

    Raises:
        OpticsError: it cannot be read, is incomplete, or is uncalibrated (K all zero).

    Warns:
        CameraInfoWarning: it reads, but contradicts itself.

    """
    infos = cameras_in(path)
    chosen = [
        info
        for info in infos
        if len(infos) == 1 or camera in (None, info.name, info.name.rpartition('/')[2])
    ]
    if len(chosen) != 1:
        names = ', '.join(info.name for info in infos)
        msg = f'{path} holds the cameras {names}; name one of them'
        raise OpticsError(msg)
    for line in chosen[0].contradictions():
        warnings.warn(f'{path}: {line}', CameraInfoWarning, stacklevel=2)
    return chosen[0]


def read_pair(
    paths: Sequence[PathLike], size: tuple[int, int] | None = None
) -> tuple[CameraInfo, CameraInfo]:
    """Read the calibrations of a left and a right camera, whoever wrote them.

    Args:
        paths: one file that holds both, those of the left and of the right one, or OpenCV's
            intrinsics and extrinsics.
        size: of the pictures, px, where FileStorage has none.

    Raises:
        OpticsError: they cannot be read, or there are not two.

    """
    data: dict[str, Any] = {}
    infos: list[CameraInfo] = []
    for path in paths:
        text = text_of(path)
        keys = {} if is_ost(text) else mapping_of(text, path)
        if is_opencv_stereo(keys):
            data |= keys
        else:
            infos += _calibrated(_cameras(text, path), path)
    if data:
        where = ' and '.join(map(str, paths))
        infos += _calibrated(cameras_of_opencv(data, where, size), where)
    if len(infos) != 2:
        names = ', '.join(info.name for info in infos)
        msg = (
            f'{" and ".join(map(str, paths))} hold {len(infos)} cameras ({names}): give a '
            'file with both, or one for each'
        )
        raise OpticsError(msg)
    return infos[0], infos[1]


def cameras_in(path: PathLike) -> list[CameraInfo]:
    """Read all cameras of a file.

    Raises:
        OpticsError: it cannot be read, is incomplete, or is uncalibrated (K all zero).

    """
    return _calibrated(_cameras(text_of(path), path), path)


def _cameras(text: str, path: PathLike) -> list[CameraInfo]:
    if is_ost(text):
        return cameras_of_ost(text, path)
    data = mapping_of(text, path)
    if is_kalibr(data):
        return cameras_of_kalibr(data, path)
    if is_opencv_stereo(data):
        return cameras_of_opencv(data, path)
    if is_message(data):
        return [camera_info_of_message(data, path)]
    return [camera_info_of(data, path)]


def _calibrated(infos: list[CameraInfo], path: PathLike) -> list[CameraInfo]:
    for info in infos:
        if not any(info.k):
            msg = (
                f'{path}: camera {info.name!r} is uncalibrated (K is all zero); calibrate it first'
            )
            raise OpticsError(msg)
    return infos


def write_camera_info(path: PathLike, info: CameraInfo) -> None:
    """Write the YAML that `camera_info_url` takes; every number reads back to the last bit."""
    lines = [
        f'image_width: {info.width}',
        f'image_height: {info.height}',
        f'camera_name: {_one_line(info.name)}',
        *_matrix('camera_matrix', 3, 3, info.k),
        f'distortion_model: {info.distortion_model}',
        *_matrix('distortion_coefficients', 1, len(info.d), info.d),
        *_matrix('rectification_matrix', 3, 3, info.r),
        *_matrix('projection_matrix', 3, 4, info.p),
    ]
    if info.binning != (0, 0) or info.roi != Roi():
        roi = info.roi
        lines += [
            f'binning_x: {info.binning[0]}',
            f'binning_y: {info.binning[1]}',
            'roi:',
            f'  x_offset: {roi.x_offset}',
            f'  y_offset: {roi.y_offset}',
            f'  height: {roi.height}',
            f'  width: {roi.width}',
            f'  do_rectify: {str(roi.do_rectify).lower()}',
        ]
    write_lines(path, lines)


def _one_line(name: str) -> str:
    """Quote a name where YAML needs it, never over several lines."""
    return str(yaml.safe_dump(name, width=math.inf)).split('\n', maxsplit=1)[0]


def _matrix(key: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
    numbers = [repr(float(value)) for value in values]
    if rows == 1:
        return [
            f'{key}:',
            f'  rows: {rows}',
            f'  cols: {columns}',
            f'  data: [{", ".join(numbers)}]',
        ]
    lead = '  data: ['
    bands = [', '.join(numbers[r * columns : (r + 1) * columns]) for r in range(rows)]
    body = (',\n' + ' ' * len(lead)).join(bands)
    return [f'{key}:', f'  rows: {rows}', f'  cols: {columns}', f'{lead}{body}]']
