"""ROS camera_info files, the calibration YAML and the older oST text, without ROS.

The YAML has the keys and the order of camera_calibration_parsers; numbers are written so that they
read back to the last bit. `CameraInfo` mirrors sensor_msgs/CameraInfo.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from binopos_ros import plain_yaml
from binopos_ros.optics import ost
from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.errors import OpticsError

FloatArray = NDArray[np.float64]
PathLike = str | os.PathLike[str]

BROWN_MODELS = ('plumb_bob', 'rational_polynomial', 'thin_prism', '')
OFF_CENTRE = 0.25  # of the image's size: farther than this the principal point is suspicious


#: Lenses have a width, m.
SHORTEST_BASELINE = 1e-3


class CameraInfoWarning(UserWarning):
    """A calibration file that reads, but contradicts itself."""


@dataclass(frozen=True)
class Roi:
    """The part of the full sensor that the images show; width 0 means all of it. Pixels."""

    x_offset: int = 0
    y_offset: int = 0
    height: int = 0
    width: int = 0
    do_rectify: bool = False


@dataclass(frozen=True)
class CameraInfo:
    """One camera's calibration, as sensor_msgs/CameraInfo has it.

    Attributes:
        name: the camera's name.
        width: of the full image, pixels.
        height: of the full image, pixels.
        distortion_model: 'plumb_bob' or 'rational_polynomial'.
        d: distortion terms, OpenCV's order.
        k: 9 numbers, the intrinsic matrix row by row.
        r: 9 numbers, the rectifying rotation row by row.
        p: 12 numbers, the projection matrix row by row.
        binning: horizontal and vertical; 0 means 1.
        roi: region of interest on the full sensor.

    """

    name: str
    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    r: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    p: tuple[float, ...] = (0.0,) * 12
    binning: tuple[int, int] = (0, 0)
    roi: Roi = field(default_factory=Roi)

    def camera(self) -> PinholeCamera:
        """Return the camera of the images as published, binning and region of interest applied.

        Raises:
            OpticsError: uncalibrated, a lens model other than Brown's, or impossible numbers.

        """
        if self.distortion_model not in BROWN_MODELS:
            msg = (
                f'camera {self.name!r}: distortion model {self.distortion_model!r} is not'
                ' supported; calibrate with plumb_bob or rational_polynomial'
            )
            raise OpticsError(msg)
        matrix = np.array(self.k, dtype=float).reshape(3, 3)
        horizontal, vertical = max(self.binning[0], 1), max(self.binning[1], 1)
        width, height = self.roi.width or self.width, self.roi.height or self.height
        if matrix.any():
            # A binned pixel's centre is the middle of the pixels it joins, half a step off theirs.
            matrix[0, 2] -= self.roi.x_offset + (horizontal - 1) / 2.0
            matrix[1, 2] -= self.roi.y_offset + (vertical - 1) / 2.0
            matrix[0] /= horizontal
            matrix[1] /= vertical
        try:
            camera = PinholeCamera(matrix, self.d, (width // horizontal, height // vertical))
        except (OpticsError, np.linalg.LinAlgError) as error:
            msg = f'camera {self.name!r}: {error}'
            raise OpticsError(msg) from None
        if not _sees_around_its_axis(camera):
            msg = (
                f'camera {self.name!r}: the distortion {list(self.d)} cannot be undone even '
                'around the principal point; calibrate again'
            )
            raise OpticsError(msg)
        return camera

    def of_rectified_pictures(self) -> CameraInfo:
        """Return the calibration of the rectified pictures: P is their camera, without distortion.

        Raises:
            OpticsError: P holds no camera.

        """
        if not (self.p[0] > 0.0 and self.p[5] > 0.0):
            msg = (
                f'camera {self.name!r}: the pictures are rectified, which needs P, but P of'
                ' camera_info has no focal length: take the pictures as they came (image_raw), or'
                ' calibrate the two as a stereo pair'
            )
            raise OpticsError(msg)
        return replace(
            self,
            distortion_model='plumb_bob',
            d=(0.0,) * 5,
            k=tuple(self.p[4 * row + column] for row in range(3) for column in range(3)),
            r=CameraInfo.r,
        )

    def contradictions(self) -> list[str]:
        """Return what in this calibration cannot be meant, one line each."""
        found = []
        for axis, size, centre in (('x', self.width, self.k[2]), ('y', self.height, self.k[5])):
            if size and abs(centre - (size - 1) / 2.0) > OFF_CENTRE * size:
                where = 'outside' if not 0.0 <= centre < size else 'far off the middle of'
                found.append(
                    f'camera {self.name!r}: the principal point c{axis} = {centre:g} px lies'
                    f' {where} an image of {self.width}x{self.height}; was the image cropped or'
                    ' scaled after the calibration?'
                )
        rotation = np.array(self.r).reshape(3, 3)
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            found.append(f'camera {self.name!r}: the rectification matrix R is not a rotation')
        return found


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


def stereo_from_camera_infos(
    left: CameraInfo, right: CameraInfo
) -> tuple[PinholeCamera, PinholeCamera, FloatArray, FloatArray]:
    """Recover a rig from a rectified pair's calibration.

    The extrinsics come out of R and P: with x_rect = R x and the baseline in P,
    rotation = R_right^T R_left and translation = R_right^T [P[0,3]/P[0,0], P[1,3]/P[1,1], 0].

    Returns:
        The left and right cameras, rotation (3, 3) and translation (3,) in the unit of P's
        baseline (metres, in ROS): x_right = rotation @ x_left + translation.

    Raises:
        OpticsError: either camera is impossible, or the pair has no baseline.

    """
    for info in (left, right):
        if not (info.p[0] > 0.0 and info.p[5] > 0.0):
            msg = (
                f'camera {info.name!r}: P has no focal length; calibrate the two as a stereo pair'
            )
            raise OpticsError(msg)
    from_left, from_right = _rectification(left), _rectification(right)
    offset = _offset(right) - _offset(left)
    if not np.linalg.norm(offset) > SHORTEST_BASELINE:
        msg = (
            f'cameras {left.name!r} and {right.name!r} have no baseline (P[0, 3] of the right one'
            f' is {right.p[3]:g}); calibrate the two as a stereo pair, in metres'
        )
        raise OpticsError(msg)
    return left.camera(), right.camera(), from_right.T @ from_left, from_right.T @ offset


def _sees_around_its_axis(camera: PinholeCamera) -> bool:
    """Whether pixels about the principal point have rays that lead back.

    Farther out a lens may fold, and its calibration be right all the same.
    """
    (width, height), centre = camera.size, np.asarray(camera.matrix)[:2, 2]
    pixels = centre + 0.05 * np.array([[u * width, v * height] for u in (-1, 1) for v in (-1, 1)])
    again = camera.project(camera.unproject(pixels))
    return bool(np.isfinite(again).all() and np.abs(again - pixels).max() < 1.0)


def _offset(info: CameraInfo) -> FloatArray:
    return np.array([info.p[3] / info.p[0], info.p[7] / info.p[5], 0.0])


def _rectification(info: CameraInfo) -> FloatArray:
    """Return R with its rounding (a file holds six digits) taken out: the nearest rotation."""
    u, _, vt = np.linalg.svd(np.array(info.r, dtype=float).reshape(3, 3))
    rotation = u @ vt
    if (
        np.abs(rotation - np.array(info.r).reshape(3, 3)).max() > 1e-2
        or np.linalg.det(rotation) < 0
    ):
        msg = f'camera {info.name!r}: the rectification matrix R is not a rotation'
        raise OpticsError(msg)
    return rotation


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
