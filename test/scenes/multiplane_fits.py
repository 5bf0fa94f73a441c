"""A real tank: four planes of dots seen by two cameras through air, glass and water.

The data are OpenPTV's multiplane example. Its published calibration, refits of the cameras, and
the water's index left free, for the tests and for `bench/triangulation/multiplane.py`. The world
frame is the dots' (z towards the cameras); lengths are metres.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

PIXEL = 0.00586e-3  # m
SIZE = (1920, 1200)
CAMERAS = (1, 2)
PLANES = (1, 2, 3, 4)
AIR, GLASS, WATER = 1.0, 1.46, 1.33  # parameters/ptv.par
NEAR_WATER, PANE = 0.006, 0.006  # the glass begins at z = 6 mm and is 6 mm thick, m
FLIP = np.diag([1.0, -1.0, -1.0])  # OpenPTV's cameras look along -z with y up, ours along +z


Image = tuple[int, int]  # its camera and its plane


class Pose(NamedTuple):
    """One camera: intrinsic matrix (px), rotation camera_from_world, centre (m)."""

    matrix: np.ndarray
    rotation: np.ndarray
    centre: np.ndarray


class Media(NamedTuple):
    """What lies before the dots."""

    water: float = WATER
    bent: bool = True


def published(folder: Path, camera: int) -> Pose:
    """Return the calibration that comes with the data."""
    numbers = np.array((folder / f'cal/cam{camera}.tif.ori').read_text().split(), dtype=float)
    x, y, constant = 1e-3 * numbers[15:18]
    focal = constant / PIXEL
    matrix = [[focal, 0, 960 + x / PIXEL], [0, focal, 600 - y / PIXEL], [0, 0, 1]]
    return Pose(np.array(matrix), FLIP @ numbers[6:15].reshape(3, 3).T, 1e-3 * numbers[:3])


def dots(folder: Path, camera: int, planes: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the dots' pixels (N, 2) and places (N, 3), m."""
    names = [folder / f'cal/plane{plane}_cam{camera}.tif' for plane in planes]
    pixels = [np.loadtxt(f'{name}.crd')[:, 1:] for name in names]
    places = [1e-3 * np.loadtxt(f'{name}.fix')[:, 1:] for name in names]
    return np.vstack(pixels), np.vstack(places)


def rig_of(left: Pose, right: Pose, media: Media) -> StereoRig:
    """Return the rig of two cameras before the tank."""
    down = np.array([0.0, 0.0, -1.0])
    air_side = np.array([0.0, 0.0, NEAR_WATER + PANE])
    surface = FlatInterface(
        left.rotation @ down, (air_side - left.centre) @ down, (AIR, GLASS, media.water), (PANE,)
    )
    return StereoRig(
        PinholeCamera(left.matrix, (), SIZE),
        PinholeCamera(right.matrix, (), SIZE),
        right.rotation @ left.rotation.T,
        right.rotation @ (left.centre - right.centre),
        surface if media.bent else None,
    )


def located(
    folder: Path, poses: list[Pose], planes: tuple[int, ...], media: Media, method: str
) -> np.ndarray:
    """Triangulate the dots and return their errors in the world frame, (N, 3) m."""
    (left, places), (right, _) = dots(folder, 1, planes), dots(folder, 2, planes)
    points = triangulate(rig_of(*poses, media), left, right, method=method).points
    return points @ poses[0].rotation + poses[0].centre - places


def rms(errors: np.ndarray) -> float:
    """Return the 3-D RMS, mm."""
    return 1e3 * float(np.sqrt((errors**2).sum(axis=1).mean()))


def refit(
    folder: Path,
    planes: tuple[int, ...],
    media: Media,
    free_index: bool = False,
    without: tuple[Image, ...] = (),
    start: list[Pose] | None = None,
) -> tuple[list[Pose], float, float]:
    """Fit both cameras' poses, camera constants and principal points to the dots.

    `without` names images that are left out.

    Returns:
        The cameras, the water's index, and its standard deviation if every dot errs on its own.

    """
    seen = [dots(folder, camera, planes) for camera in CAMERAS]
    places = seen[0][1]
    dots_each = len(places) // len(planes)
    kept = [
        np.repeat([(camera, plane) not in without for plane in planes], dots_each)
        for camera in (1, 2)
    ]
    start = start or [published(folder, camera) for camera in (1, 2)]
    # At most 90 mrad apart from the start, so a rotation vector to multiply on is regular.
    guess = np.zeros(19)
    for at, pose in zip((3, 12), start, strict=True):
        guess[at : at + 3] = pose.centre
        guess[at + 3 : at + 6] = pose.matrix[[0, 0, 1], [0, 2, 2]]
    guess[18] = media.water

    def poses(x: np.ndarray) -> list[Pose]:
        found = []
        for (first, last), pose in zip(pairwise((0, 9, 18)), start, strict=True):
            turn, centre, (focal, u, v) = np.split(x[first:last], 3)
            matrix = np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]])
            found.append(Pose(matrix, cv2.Rodrigues(turn)[0] @ pose.rotation, centre))
        return found

    def residuals(x: np.ndarray) -> np.ndarray:
        left, right = poses(x)
        index = float(x[18]) if free_index else media.water
        rig = rig_of(left, right, media._replace(water=index))
        points = (places - left.centre) @ left.rotation.T
        images = zip(rig.project(points), seen, kept, strict=True)
        return np.concatenate([(image - dot)[which].ravel() for image, (dot, _), which in images])

    # Without the index its column is zero, which MINPACK's scaling takes.
    fit = least_squares(residuals, guess, method='lm', x_scale='jac', xtol=1e-9, ftol=1e-9)
    free = slice(None) if free_index else slice(0, 18)
    variance = (fit.fun**2).sum() / (len(fit.fun) - 19)
    spread = np.linalg.inv(fit.jac[:, free].T @ fit.jac[:, free]) * variance
    deviation = float(np.sqrt(spread[18, 18])) if free_index else 0.0
    return poses(fit.x), float(fit.x[18]), deviation


class FreeIndex(NamedTuple):
    """The water's index left free, and its standard deviation by what is taken to err as one."""

    index: float
    dots: float  # every dot errs on its own
    images: float  # an image errs as one: leaving out one of the eight at a time (jackknife)
    planes: float  # a plane errs as one in both cameras: leaving out one of the four

    @property
    def interval(self) -> float:
        """Half of the 95 % interval: an image errs as one, eight of them are few (Student)."""
        return float(self.images * student.ppf(0.975, len(CAMERAS) * len(PLANES) - 1))


def jackknife(left_out: list[float]) -> float:
    """Return the standard deviation of an estimate from its values with one group left out."""
    return float(np.sqrt((len(left_out) - 1) * np.var(left_out)))


def free_index(folder: Path) -> FreeIndex:
    """Leave the water's index free in the refit to all planes."""
    poses, best, own = refit(folder, PLANES, Media(), True)

    def index(*without: Image) -> float:
        return refit(folder, PLANES, Media(best), True, without, poses)[1]

    images = [index((camera, plane)) for camera in CAMERAS for plane in PLANES]
    planes = [index(*((camera, plane) for camera in CAMERAS)) for plane in PLANES]
    return FreeIndex(best, own, jackknife(images), jackknife(planes))
