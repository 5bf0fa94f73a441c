"""A calibration as ROS has it, without ROS: `CameraInfo` mirrors sensor_msgs/CameraInfo."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics.camera import PinholeCamera
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.lens import BROWN, EQUIDISTANT

FloatArray = NDArray[np.float64]
PathLike = str | os.PathLike[str]

#: What the lens models of `PinholeCamera` are called in files and messages.
LENS_OF_MODEL = {
    'plumb_bob': BROWN,
    'rational_polynomial': BROWN,
    'thin_prism': BROWN,
    '': BROWN,
    'equidistant': EQUIDISTANT,
    'fisheye': EQUIDISTANT,
}
#: What others call the lenses that ROS has a name for.
OTHER_NAMES = {
    'radtan': 'plumb_bob',
    'radial-tangential': 'plumb_bob',
    'fisheye': EQUIDISTANT,
    'equi': EQUIDISTANT,
    'kannala_brandt': EQUIDISTANT,
    'kannala_brandt4': EQUIDISTANT,
}
PLUMB_BOB_TERMS = 5
OFF_CENTRE = 0.25  # of the image's size: farther than this the principal point is suspicious

#: Lenses have a width, m.
SHORTEST_BASELINE = 1e-3
#: m; what a robot carries. In millimetres even the shortest baseline is longer.
LONGEST_BASELINE = 10.0


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
        distortion_model: 'plumb_bob', 'rational_polynomial' or 'equidistant'.
        d: distortion terms, OpenCV's order; four where equidistant.
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
            OpticsError: uncalibrated, an unknown lens model, or impossible numbers.

        """
        if self.distortion_model not in LENS_OF_MODEL:
            msg = (
                f'camera {self.name!r}: distortion model {self.distortion_model!r} is not'
                ' supported; calibrate with plumb_bob, rational_polynomial or equidistant'
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
            camera = PinholeCamera(
                matrix,
                self.d,
                (width // horizontal, height // vertical),
                LENS_OF_MODEL[self.distortion_model],
            )
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
        found = self._centres_off(inside=True) + self.outside()
        rotation = np.array(self.r).reshape(3, 3)
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4):
            found.append(f'camera {self.name!r}: the rectification matrix R is not a rotation')
        return found

    def usable_camera(self) -> PinholeCamera:
        """Return `camera()`, of a calibration with which a position can be right.

        Raises:
            OpticsError: as `camera`, or the principal point lies outside the image.

        """
        camera = self.camera()
        for line in self.outside():
            raise OpticsError(line)
        return camera

    def outside(self) -> list[str]:
        """Return that the principal point lies outside the image, one line for each axis.

        No position is right then, unless the image was cut and the file should say so (roi).
        """
        return self._centres_off(inside=False)

    def _centres_off(self, *, inside: bool) -> list[str]:
        """Tell of a principal point that is far off the middle, in the image or outside it."""
        found = []
        for axis, size, centre in (('x', self.width, self.k[2]), ('y', self.height, self.k[5])):
            off = size and abs(centre - (size - 1) / 2.0) > OFF_CENTRE * size
            if off and inside == (0.0 <= centre < size):
                where = 'far off the middle of' if inside else 'outside'
                found.append(
                    f'camera {self.name!r}: the principal point c{axis} = {centre:g} px lies'
                    f' {where} an image of {self.width}x{self.height}; was the image cropped or'
                    ' scaled after the calibration?'
                )
        return found


def lens_model(said: str, terms: int, camera_model: str = '') -> str:
    """Return ROS's name of a lens model.

    Args:
        said: what a file or a message calls it; '' where it says nothing.
        terms: how many distortion terms there are: 8 and more without a name are rational.
        camera_model: the key of that name in files of ROS's calibrator of 2018 to 2020.

    """
    name = (said or ('fisheye' if camera_model.lower() == 'fisheye' else '')).strip()
    if name:
        return OTHER_NAMES.get(name.lower(), name)
    return 'plumb_bob' if terms <= PLUMB_BOB_TERMS else 'rational_polynomial'


def stereo_from_camera_infos(
    left: CameraInfo, right: CameraInfo
) -> tuple[PinholeCamera, PinholeCamera, FloatArray, FloatArray]:
    """Recover a rig from a rectified pair's calibration; whoever uses a calibration comes by here.

    The extrinsics come out of R and P: with x_rect = R x and the baseline in P,
    rotation = R_right^T R_left and translation = R_right^T [P[0,3]/P[0,0], P[1,3]/P[1,1], 0].
    The rows of a rectified pair are the epipolar lines, or, where one camera is above the other,
    the columns: then P[1,3] holds the baseline.

    Returns:
        The left and right cameras, rotation (3, 3) and translation (3,) in the unit of P's
        baseline (metres, in ROS): x_right = rotation @ x_left + translation.

    Raises:
        OpticsError: either camera is impossible, or the baseline is: none, exchanged, or of a
            length that no rig has.

    """
    cameras = left.camera(), right.camera()
    for info in (left, right):
        if not (info.p[0] > 0.0 and info.p[5] > 0.0):
            msg = (
                f'camera {info.name!r}: P has no focal length; calibrate the two as a stereo pair'
            )
            raise OpticsError(msg)
    from_left, from_right = _rectification(left), _rectification(right)
    offset = _offset(right) - _offset(left)
    _check_baseline(left, right, offset)
    return *cameras, from_right.T @ from_left, from_right.T @ offset


def _check_baseline(left: CameraInfo, right: CameraInfo, offset: FloatArray) -> None:
    """See that the right camera is where a right camera can be; raises OpticsError."""
    names, length = f'{left.name!r} and {right.name!r}', float(np.linalg.norm(offset))
    of_left, of_right = (bool(np.any(_offset(info))) for info in (left, right))
    if not of_left and not of_right:
        msg = (
            f'cameras {names} have no baseline: both calibrations hold no baseline (P[3] and P[7] '
            'are 0); make them with "binopos calibrate stereo"'
        )
    elif length == 0.0:
        place = 3 if left.p[3] else 7
        msg = (
            f'the calibrations of {names} hold the same P[{place}] = {left.p[place]:g}: both are '
            'the calibration of a right camera; name that of the left one for the left'
        )
    elif length < SHORTEST_BASELINE or length > LONGEST_BASELINE:
        msg = (
            f'the calibrations of {names} hold a baseline of {length:.4g} m, which no rig has: '
            'P[3] (or P[7]) of the right one is minus focal length times baseline, in metres; '
            "was the side of the board's squares given in another unit?"
        )
    elif of_left and not of_right and _is_exchanged(offset):
        msg = (
            f'{names}: left has the calibration of the right camera and the other way round: '
            'exchange the two files'
        )
    else:
        return
    raise OpticsError(msg)


def stereo_contradictions(left: CameraInfo, right: CameraInfo) -> list[str]:
    """Return what in a rig's calibration is probably not meant, one line each.

    Of a pair that `stereo_from_camera_infos` takes: a rig whose cameras and calibrations are
    exchanged alike gives right positions, one in which only these are gives none.
    """
    offset = _offset(right) - _offset(left)
    if not _is_exchanged(offset):
        return []
    return [
        f'{left.name!r} and {right.name!r}: the right camera is {np.linalg.norm(offset):.4g} m to '
        'the left of the left one: exchange left and right, cameras and calibrations'
    ]


def _is_exchanged(offset: FloatArray) -> bool:
    return bool(offset[0] > abs(offset[1]))


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
