"""The cameras' calibration files: found by URL, and checked against the cameras they are for."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote

from binopos_ros.optics.camera_info import CameraInfo
from binopos_ros.optics.camera_info_files import read_camera_info
from binopos_ros.optics.errors import OpticsError

FILE, PACKAGE = 'file://', 'package://'


def calibration_path(url: str) -> Path:
    """The file that a `camera_info_url` means: `file://`, `package://NAME/PATH` or a plain path.

    :raises OpticsError: where the scheme or the package is unknown.
    """
    if url.startswith(FILE):
        return Path(unquote(url.removeprefix(FILE))).expanduser()
    if url.startswith(PACKAGE):
        package, _, inside = unquote(url.removeprefix(PACKAGE)).partition('/')
        return Path(_share(package, url)) / inside
    if '://' in url:
        message = f'camera_info_url {url!r}: give file://PATH, package://NAME/PATH or a path'
        raise OpticsError(message)
    return Path(url).expanduser()


def read_calibration(side: str, url: str, view_size: tuple[int, int]) -> CameraInfo:
    """Read a camera's calibration and see that it is for images of this size (px).

    :raises OpticsError: where it is of another size.
    :raises OpticsError: where it cannot be read.
    """
    path = calibration_path(url)
    info = read_camera_info(path)
    if (info.width, info.height) != view_size:
        message = (
            f'{side}.camera_info_url: {path} is for images of {info.width}x{info.height}, the '
            'camera sends {}x{}; calibrate at this size, or set width and height'.format(
                *view_size
            )
        )
        raise OpticsError(message)
    return info


def check_pair(left: CameraInfo, right: CameraInfo) -> None:
    """See that two calibrations are those of a left and of a right camera.

    The right camera's projection holds the baseline, P[3] = -f B; the left's holds none.

    :raises OpticsError: where they are one and the same, or exchanged.
    """
    if left.p[3] == 0.0 == right.p[3]:
        message = (
            'the calibrations of left and right hold no baseline (P[3] is 0 in both): '
            'make them with "binopos calibrate stereo"'
        )
        raise OpticsError(message)
    if left.p[3] != 0.0 and right.p[3] == 0.0:
        message = (
            'left.camera_info_url is the calibration of the right camera and the other way '
            'round: exchange the two files'
        )
        raise OpticsError(message)
    if left.p[3] != 0.0:
        message = (
            'left.camera_info_url is the calibration of a right camera (its P[3] is not 0): name '
            'that of the left one'
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
