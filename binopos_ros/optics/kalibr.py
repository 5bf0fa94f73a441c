"""The camera chain of kalibr (`camchain.yaml`): a pair of cameras, each with its place in a chain.

`T_cn_cnm1` takes a point from the frame of the camera before into the camera's own, so the second
one's is right_from_left.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from binopos_ros.optics.calibration_text import write_lines
from binopos_ros.optics.camera_info import (
    CameraInfo,
    lens_model,
    stereo_from_camera_infos,
)
from binopos_ros.optics.camera_info_fields import finite, numbers
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.lens import EQUIDISTANT
from binopos_ros.optics.rig_files import camera_infos_from_parts, yaml_numbers
from binopos_ros.sides import SIDES

PathLike = str | os.PathLike[str]
CAMERAS = ('cam0', 'cam1')
TRANSFORM = 'T_cn_cnm1'
#: kalibr's names of the lenses that are known here: ROS's, and how many terms they have.
LENSES = {'radtan': 'plumb_bob', 'equidistant': EQUIDISTANT, 'none': 'plumb_bob'}
TERMS = 4


def is_kalibr(data: Mapping[str, Any]) -> bool:
    """Tell whether the keys are those of a camera chain."""
    return isinstance(data.get(CAMERAS[0]), dict) and 'intrinsics' in data[CAMERAS[0]]


def cameras_of_kalibr(data: Mapping[str, Any], path: PathLike) -> list[CameraInfo]:
    """The cameras of a chain, cam0 as the left one and cam1 as the right one.

    Raises:
        OpticsError: a model that is not known here, something missing, or no second camera's
            place.
    """
    parts: list[CameraInfo] = []
    for key, side in zip(CAMERAS, SIDES, strict=True):
        camera = data.get(key)
        if not isinstance(camera, dict):
            if key == CAMERAS[0]:
                raise OpticsError(f'{path}: {key} holds no camera')
            return parts
        parts.append(_camera(camera, side, f'{path}: {key}'))
    if TRANSFORM not in data[CAMERAS[1]]:
        msg = (
            f'{path}: {CAMERAS[1]} has no {TRANSFORM}, the place of the left camera in its frame: '
            'calibrate both with kalibr in one run'
        )
        raise OpticsError(msg)
    transform = np.reshape(numbers(data[CAMERAS[1]], TRANSFORM, 16, path), (4, 4))
    return list(camera_infos_from_parts(parts[0], parts[1], transform[:3, :3], transform[:3, 3]))


def write_kalibr(path: PathLike, left: CameraInfo, right: CameraInfo) -> None:
    """Write both cameras as a chain.

    Raises:
        OpticsError: kalibr has no such lens, the two make no rig, or the file cannot be written.
    """
    _, _, rotation, translation = stereo_from_camera_infos(left, right)
    transform = np.vstack([np.column_stack([rotation, translation]), [0.0, 0.0, 0.0, 1.0]])
    lines: list[str] = []
    for i, (key, info) in enumerate(zip(CAMERAS, (left, right), strict=True)):
        lines.append(f'{key}:')
        if i:
            lines += [f'  {TRANSFORM}:', *(f'  - {yaml_numbers(row)}' for row in transform)]
        lens = 'equidistant' if info.distortion_model == EQUIDISTANT else 'radtan'
        if any(info.d[TERMS:]):
            msg = (
                f'camera {info.name!r} has {len(info.d)} distortion terms, kalibr has {TERMS}: '
                'nothing of the same lens can be written'
            )
            raise OpticsError(msg)
        fx, fy, cx, cy = (info.k[place] for place in (0, 4, 2, 5))
        lines += [
            f'  cam_overlaps: [{1 - i}]',
            '  camera_model: pinhole',
            f'  distortion_coeffs: {yaml_numbers((*info.d, *[0.0] * TERMS)[:TERMS])}',
            f'  distortion_model: {lens}',
            f'  intrinsics: {yaml_numbers((fx, fy, cx, cy))}',
            f'  resolution: [{info.width}, {info.height}]',
            f'  rostopic: /stereo/{SIDES[i]}/image_raw',
        ]
    write_lines(path, lines)


def _camera(camera: Mapping[str, Any], name: str, where: str) -> CameraInfo:
    model, lens = str(camera.get('camera_model')), str(camera.get('distortion_model'))
    if model != 'pinhole' or lens not in LENSES:
        msg = (
            f'{where} is of kalibr, model {model}-{lens}, which is not read: calibrate with '
            'pinhole-radtan (or pinhole-equi for a fisheye lens)'
        )
        raise OpticsError(msg)
    fx, fy, cx, cy = numbers(camera, 'intrinsics', 4, where)
    width, height = (int(v) for v in numbers(camera, 'resolution', 2, where))
    terms = finite(camera.get('distortion_coeffs') or [], 'distortion_coeffs', None, where)
    return CameraInfo(
        name=name,
        width=width,
        height=height,
        distortion_model=lens_model(LENSES[lens], len(terms)),
        d=terms if LENSES[lens] == EQUIDISTANT else (*terms, *[0.0] * 5)[:5],
        k=(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0),
    )
