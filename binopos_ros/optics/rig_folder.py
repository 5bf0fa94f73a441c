"""A rig out of a folder of calibration files, as `binopos calibrate` and recordings leave them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from binopos_ros import plain_yaml
from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.camera_info import stereo_from_camera_infos
from binopos_ros.optics.camera_info_files import read_camera_info
from binopos_ros.optics.dome import DomePort
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.interface import FlatInterface, Interface

#: Parameter files, of which the first that is there says what the cameras look through.
PARAMETER_FILES = ('rig.yaml', 'interface.yaml', 'binopos.yaml')
PLACES = ('interface', 'left_port', 'right_port')
SIDES = ('left', 'right')


class RigParts(NamedTuple):
    """What a `StereoRig` is made of, in its order."""

    left: PinholeCamera
    right: PinholeCamera
    rotation: Any
    translation: Any
    interface: FlatInterface | None
    left_port: Interface | None
    right_port: Interface | None


def parts_in(folder: Path) -> RigParts:
    """Read left.yaml, right.yaml and, where there is one, a parameter file of the triangulator.

    Raises:
        OpticsError: a file is missing, or cannot be used.
    """
    paths = [folder / f'{side}.yaml' for side in SIDES]
    for path in paths:
        if not path.is_file():
            msg = f'{path} is not there: give a folder that `binopos calibrate` has written'
            raise OpticsError(msg)
    cameras = stereo_from_camera_infos(*map(read_camera_info, paths))
    files = [path for name in PARAMETER_FILES if (path := folder / name).is_file()]
    if not files:
        return RigParts(*cameras, None, None, None)
    path = files[0]
    values = _triangulator(path)
    try:
        interface, left, right = (_surface(values, place) for place in PLACES)
    except (KeyError, TypeError, ValueError) as error:
        told = f'{error} is missing' if isinstance(error, KeyError) else str(error)
        msg = f'{path}: {told}'
        raise OpticsError(msg) from None
    if interface is not None and not isinstance(interface, FlatInterface):
        msg = f'{path}: interface is a dome: each camera has its own, left_port and right_port'
        raise OpticsError(msg)
    return RigParts(*cameras, interface, left, right)


def _triangulator(path: Path) -> dict[str, Any]:
    """The triangulator's parameters in a file, by dotted name; later blocks win."""
    try:
        blocks = plain_yaml.load(path.read_text(encoding='utf-8')) or {}
    except (OSError, UnicodeDecodeError, plain_yaml.PlainYamlError) as error:
        msg = f'{path}: cannot be read: {error}'
        raise OpticsError(msg) from None
    values: dict[str, Any] = {}
    for key, block in blocks.items() if isinstance(blocks, dict) else ():
        if str(key).rpartition('/')[2] in ('triangulator', '**', '*') and isinstance(block, dict):
            values |= _flat(block.get('ros__parameters') or {}, '')
    return values


def _flat(block: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, value in block.items():
        if isinstance(value, Mapping):
            values |= _flat(value, f'{prefix}{name}.')
        else:
            values[f'{prefix}{name}'] = value
    return values


def _surface(values: Mapping[str, Any], place: str) -> Interface | None:
    given = {
        name.removeprefix(f'{place}.'): value
        for name, value in values.items()
        if name.startswith(f'{place}.')
    }
    if not given.get('indices'):
        return None
    if given.get('shape') == 'dome':
        (thickness,) = given['thicknesses']
        return DomePort(given['centre'], given['radius'], thickness, given['indices'])
    return FlatInterface(
        given['normal'], given['distance'], given['indices'], given.get('thicknesses') or ()
    )
