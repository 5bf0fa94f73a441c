"""One camera's calibration out of a mapping: the keys of a file, or those of a message.

People's files have nested rows, whole numbers as 640.0, and lens models by other names; all of
that is read, and what cannot be meant is refused with its key.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from binopos_ros.optics.camera_info import CameraInfo, Roi, lens_model
from binopos_ros.optics.errors import OpticsError

PathLike = str | os.PathLike[str]
#: Keys of a printed message, ROS 2 and ROS 1, and those of a file that mean the same.
OF_MESSAGE = {
    'width': 'image_width',
    'height': 'image_height',
    **{letter: 'distortion_coefficients' for letter in 'dD'},
    **{letter: 'camera_matrix' for letter in 'kK'},
    **{letter: 'rectification_matrix' for letter in 'rR'},
    **{letter: 'projection_matrix' for letter in 'pP'},
}


def is_message(data: Mapping[str, Any]) -> bool:
    """Tell whether the keys are those of a printed sensor_msgs/CameraInfo."""
    return {'width', 'height'} <= data.keys() and bool({'k', 'K'} & data.keys())


def camera_info_of_message(data: Mapping[str, Any], path: PathLike) -> CameraInfo:
    """The calibration that `ros2 topic echo` printed; its name is the frame's.

    Raises:
        OpticsError: something is missing or impossible.
    """
    header = data.get('header')
    frame = header.get('frame_id', '') if isinstance(header, dict) else ''
    keys = {OF_MESSAGE.get(key, key): value for key, value in data.items()}
    return camera_info_of({'camera_name': frame, **keys}, path)


def camera_info_of(data: Mapping[str, Any], path: PathLike) -> CameraInfo:
    """The calibration under the keys of a camera_info file.

    Raises:
        OpticsError: something is missing or impossible.
    """
    roi = data.get('roi') or {}
    if not isinstance(roi, dict):
        msg = f'{path}: roi must be a block of x_offset, y_offset, height, width, do_rectify'
        raise OpticsError(msg)
    width, height = whole(data, 'image_width', path), whole(data, 'image_height', path)
    terms = numbers(data, 'distortion_coefficients', None, path)
    said, model = data.get('distortion_model') or '', data.get('camera_model', '')
    return CameraInfo(
        name=str(data.get('camera_name', '')),
        width=width,
        height=height,
        distortion_model=lens_model(
            str(said), len(terms), 'fisheye' if is_fisheye(data) else str(model)
        ),
        d=terms,
        k=numbers(data, 'camera_matrix', 9, path),
        r=numbers(data, 'rectification_matrix', 9, path, CameraInfo.r),
        p=numbers(data, 'projection_matrix', 12, path, CameraInfo.p),
        binning=(whole(data, 'binning_x', path, 0), whole(data, 'binning_y', path, 0)),
        roi=Roi(
            x_offset=whole(roi, 'x_offset', path, 0),
            y_offset=whole(roi, 'y_offset', path, 0),
            height=whole(roi, 'height', path, 0),
            width=whole(roi, 'width', path, 0),
            do_rectify=bool(roi.get('do_rectify', False)),
        ),
    )


def whole(data: Mapping[str, Any], key: str, path: PathLike, default: int | None = None) -> int:
    """A whole number of pixels; 640.0 is one.

    Raises:
        OpticsError: it is none.
    """
    value = data.get(key, default)
    try:
        number = float(value) if not isinstance(value, bool) else math.nan  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not (number >= 0.0 and number.is_integer()):
        msg = f'{path}: {key} must be a whole number of pixels, not {value!r}'
        raise OpticsError(msg)
    return int(number)


def numbers(
    data: Mapping[str, Any],
    key: str,
    count: int | None,
    path: PathLike,
    default: tuple[float, ...] | None = None,
) -> tuple[float, ...]:
    """The numbers of a matrix, row by row: a list, a list of rows, or a block with `data`.

    Args:
        data: where the matrix is.
        key: its name.
        count: how many numbers it has; None for any.
        path: of the file, to be told.
        default: what an absent one is.

    Raises:
        OpticsError: it is missing, or holds other things or another count.
    """
    if key not in data and default is not None:
        return default
    block = data.get(key)
    values = block.get('data') if isinstance(block, dict) else block
    if not isinstance(values, list):
        msg = f'{path}: {key} is missing or holds no data list'
        raise OpticsError(msg)
    return finite(list(_flat(values)), key, count, path)


def finite(
    values: Sequence[Any], key: str, count: int | None, path: PathLike
) -> tuple[float, ...]:
    """Finite numbers, so many of them.

    Raises:
        OpticsError: they are not.
    """
    try:
        found = tuple(float(value) for value in values)
    except (TypeError, ValueError, OverflowError):
        found = (math.nan,)
    if not all(map(math.isfinite, found)):
        msg = f'{path}: {key} holds something that is not a finite number'
        raise OpticsError(msg)
    if count is not None and len(found) != count:
        msg = f'{path}: {key} must hold {count} numbers, not {len(found)}'
        raise OpticsError(msg)
    return found


def _flat(values: Sequence[Any]) -> Iterator[Any]:
    for value in values:
        yield from value if isinstance(value, list) else (value,)


def is_fisheye(data: Mapping[str, Any]) -> bool:
    """Tell whether OpenCV's flag for a fisheye lens is set; FileStorage has it as a number."""
    return str(data.get('fisheye_model', '0')) not in ('0', 'false', 'False')
