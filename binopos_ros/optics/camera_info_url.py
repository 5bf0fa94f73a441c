"""The cameras' calibration files: found by URL, and checked against the cameras they are for."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote

from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.camera_info_files import read_camera_info
from binopos_ros.optics.errors import OpticsError

#: The longer one first.
FILE, PACKAGE = ('file://', 'file:'), 'package://'


def calibration_path(url: str, name: str = '') -> Path:
    """The file that a `camera_info_url` means: `file://`, `package://NAME/PATH` or a plain path.

    `${NAME}` stands for the camera's name, `${ROS_HOME}` for the folder of ROS, as in
    camera_info_manager.

    :raises OpticsError: where the scheme, the package or the variable is unknown.
    """
    home = os.environ.get('ROS_HOME') or str(Path('~/.ros').expanduser())
    url = url.replace('${ROS_HOME}', home).replace('${NAME}', name)
    if '${' in url:
        message = f'camera_info_url {url!r}: only ${{NAME}} and ${{ROS_HOME}} are known'
        raise OpticsError(message)
    for scheme in FILE:
        if url.startswith(scheme):
            return Path(unquote(url.removeprefix(scheme))).expanduser()
    if url.startswith(PACKAGE):
        package, _, inside = unquote(url.removeprefix(PACKAGE)).partition('/')
        return Path(_share(package, url)) / inside
    if '://' in url:
        message = f'camera_info_url {url!r}: give file://PATH, package://NAME/PATH or a path'
        raise OpticsError(message)
    return Path(url).expanduser()


def read_calibration(side: str, url: str, view_size: tuple[int, int]) -> CameraInfo:
    """Read a camera's calibration and see that it is for images of this size (px).

    The size is that of the images as they are sent: of the whole sensor, less what binning and
    the region of interest take away.

    :raises OpticsError: where it is of another size, or of a camera that cannot be.
    :raises OpticsError: where it cannot be read.
    """
    path = calibration_path(url, side)
    info = read_camera_info(path, side)
    try:
        check_size(info, view_size)
    except OpticsError as error:
        message = f'{side}.camera_info_url: {path}: {error}'
        raise OpticsError(message) from None
    return info


def check_size(info: CameraInfo, view_size: tuple[int, int]) -> None:
    """See that a calibration is of a possible camera, and for images of this size (px).

    :raises OpticsError: where it is not.
    """
    size = info.usable_camera().size
    if size != view_size:
        message = (
            f'it is for images of {size[0]}x{size[1]}, the camera sends '
            f'{view_size[0]}x{view_size[1]}; calibrate at this size, or set width and height'
        )
        raise OpticsError(message)


def name_fault(info: CameraInfo, own_serial: str, other_serial: str) -> str:
    """Why a calibration cannot be this camera's, by the serial in its name; '' where it may be."""
    if other_serial and other_serial in info.name and own_serial not in info.name:
        return (
            f'the calibration {info.name!r} is that of the other camera (serial {other_serial}): '
            'exchange the devices or the files'
        )
    return ''


def _share(package: str, url: str) -> str:
    from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

    try:
        share: str = get_package_share_directory(package)
    except (PackageNotFoundError, ValueError, OSError) as error:
        message = (
            f'camera_info_url {url!r}: no package {package!r} is found; source the workspace that '
            'holds it, or give a path'
        )
        raise OpticsError(message) from error
    return share
