"""ROS camera_info files: the calibration YAML and the older oST text.

The YAML has the keys and the order of camera_calibration_parsers; numbers are written so that they
read back to the last bit.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from binopos_ros import plain_yaml
from binopos_ros.optics import ost
from binopos_ros.optics.camera_info import CameraInfo, CameraInfoWarning, Roi
from binopos_ros.optics.errors import OpticsError

PathLike = str | os.PathLike[str]


def read_camera_info(path: PathLike, camera: str | None = None) -> CameraInfo:
    """Read one camera's calibration, YAML or oST text.

    Args:
        path: the file.
        camera: which one, where an oST file holds several.

    Raises:
        OpticsError: it cannot be read, is incomplete, or is uncalibrated (K all zero).

    Warns:
        CameraInfoWarning: it reads, but contradicts itself.

    """
    text = _text(path)
    if ost.is_ost(text):
        infos = _parse_ost(text, path)
        chosen = [info for info in infos if camera in (None, info.name)]
        if len(chosen) != 1:
            names = ', '.join(info.name for info in infos)
            msg = f'{path} holds the cameras {names}; name one of them'
            raise OpticsError(msg)
        info = chosen[0]
    else:
        info = _parse_yaml(text, path)
    if not any(info.k):
        msg = f'{path}: camera {info.name!r} is uncalibrated (K is all zero); calibrate it first'
        raise OpticsError(msg)
    for line in info.contradictions():
        warnings.warn(f'{path}: {line}', CameraInfoWarning, stacklevel=2)
    return info


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
    try:
        Path(path).write_text('\n'.join(lines) + '\n', encoding='utf-8')
    except OSError as error:
        msg = f'cannot write {path}: {error.strerror}'
        raise OpticsError(msg) from None


def _text(path: PathLike) -> str:
    try:
        return Path(path).read_text(encoding='utf-8')
    except OSError as error:
        msg = f'cannot read the calibration {path}: {error.strerror}'
        raise OpticsError(msg) from None
    except UnicodeDecodeError:
        msg = f'{path} is no calibration file: it is not text'
        raise OpticsError(msg) from None


def _parse_yaml(text: str, path: PathLike) -> CameraInfo:
    try:
        data = plain_yaml.load(text)
    except plain_yaml.PlainYamlError as error:
        where = f', line {error.line}' if error.line else ''
        msg = f'{path}{where} is not valid YAML: {error.problem}'
        raise OpticsError(msg) from None
    if not isinstance(data, dict):
        msg = f'{path} is no camera_info file: it has no keys such as image_width'
        raise OpticsError(msg)
    model = data.get('distortion_model', 'plumb_bob')
    roi = data.get('roi') or {}
    if not isinstance(roi, dict):
        msg = f'{path}: roi must be a block of x_offset, y_offset, height, width, do_rectify'
        raise OpticsError(msg)
    return CameraInfo(
        name=str(data.get('camera_name', '')),
        width=_whole(data, 'image_width', path),
        height=_whole(data, 'image_height', path),
        distortion_model=str(model),
        d=_numbers(data, 'distortion_coefficients', None, path),
        k=_numbers(data, 'camera_matrix', 9, path),
        r=_numbers(data, 'rectification_matrix', 9, path, CameraInfo.r),
        p=_numbers(data, 'projection_matrix', 12, path, CameraInfo.p),
        binning=(_whole(data, 'binning_x', path, 0), _whole(data, 'binning_y', path, 0)),
        roi=Roi(
            x_offset=_whole(roi, 'x_offset', path, 0),
            y_offset=_whole(roi, 'y_offset', path, 0),
            height=_whole(roi, 'height', path, 0),
            width=_whole(roi, 'width', path, 0),
            do_rectify=bool(roi.get('do_rectify', False)),
        ),
    )


def _whole(data: dict[str, Any], key: str, path: PathLike, default: int | None = None) -> int:
    value = data.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        msg = f'{path}: {key} must be a whole number of pixels, not {value!r}'
        raise OpticsError(msg)
    return value


def _numbers(
    data: dict[str, Any],
    key: str,
    count: int | None,
    path: PathLike,
    default: tuple[float, ...] | None = None,
) -> tuple[float, ...]:
    if key not in data and default is not None:
        return default
    block = data.get(key)
    values = block.get('data') if isinstance(block, dict) else block
    if not isinstance(values, list):
        msg = f'{path}: {key} is missing or holds no data list'
        raise OpticsError(msg)
    return _finite(values, key, count, path)


def _finite(
    values: Sequence[Any], key: str, count: int | None, path: PathLike
) -> tuple[float, ...]:
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        numbers = (math.nan,)
    if not all(map(math.isfinite, numbers)):
        msg = f'{path}: {key} holds something that is not a finite number'
        raise OpticsError(msg)
    if count is not None and len(numbers) != count:
        msg = f'{path}: {key} must hold {count} numbers, not {len(numbers)}'
        raise OpticsError(msg)
    return numbers


def _parse_ost(text: str, path: PathLike) -> list[CameraInfo]:
    infos: list[CameraInfo] = []
    size: dict[str, tuple[float, ...]] = {}
    for section, titled in ost.sections(text):
        numbers = {title: _finite(words, title, None, path) for title, words in titled.items()}
        if section == 'image':
            size = numbers
        else:
            infos.append(_camera_of_ost(section, size, numbers, path))
    if not infos:
        msg = f'{path} is no calibration: it holds no camera'
        raise OpticsError(msg)
    return infos


def _camera_of_ost(
    name: str,
    size: dict[str, tuple[float, ...]],
    numbers: dict[str, tuple[float, ...]],
    path: PathLike,
) -> CameraInfo:
    wanted = {'camera matrix': 9, 'distortion': None, 'rectification': 9, 'projection': 12}
    for key, count in wanted.items():
        found = len(numbers.get(key, ()))
        if not found or (count is not None and found != count):
            msg = (
                f'{path}: [{name[:80]}] needs {count or "some"} numbers under {key!r}, not {found}'
            )
            raise OpticsError(msg)
    width, height = (size.get(key, (0.0,)) for key in ('width', 'height'))
    return CameraInfo(
        name=name,
        width=int(width[0]),
        height=int(height[0]),
        distortion_model='plumb_bob' if len(numbers['distortion']) <= 5 else 'rational_polynomial',
        d=numbers['distortion'],
        k=numbers['camera matrix'],
        r=numbers['rectification'],
        p=numbers['projection'],
    )


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
