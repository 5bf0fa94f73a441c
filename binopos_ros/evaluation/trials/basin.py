"""A target under a wavy surface as a stereo rig measures it that takes the surface for flat.

Light follows Fermat's principle to the true, wavy surface of each instant; the measured pixels
are then traced back through the mean, flat surface, as the triangulator would. So the error's
colour, its correlation between the axes, its growth into depth and its tails near foci are the
optics' own.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.simulation.waves import WaveField
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.medium import MediumMeter

Array = NDArray[np.float64]

#: Pairs that leave more are no pairs (px): the triangulator's own default.
LARGEST_MISS = 10.0
_TOLERANCE = 1e-10
_ITERATIONS = 12
_LONGEST_STEP = 0.02


@dataclasses.dataclass(frozen=True)
class Basin:
    """Two parallel cameras in air above water; the rig frame is the left camera's (z down).

    Attributes
    ----------
    surface : float
        Distance from the cameras to the mean surface (m).
    baseline : float
        Distance of the right camera along x (m).
    focal_length : float
        Of both cameras (px).
    index : float
        Refractive index of the water relative to the air.

    """

    surface: float = 0.8
    baseline: float = 0.23
    focal_length: float = 900.0
    index: float = 1.3325

    @property
    def rig(self) -> StereoRig:
        """The rig that takes the surface for flat; pixels are relative to the principal point."""
        matrix = np.diag([self.focal_length, self.focal_length, 1.0])
        camera = PinholeCamera(matrix, np.zeros(4), (4096, 4096))
        water = FlatInterface([0.0, 0.0, 1.0], self.surface, [1.0, self.index])
        return StereoRig(camera, camera, np.eye(3), [-self.baseline, 0.0, 0.0], water)

    def pixels(
        self, targets: Array, times: Array, waves: WaveField, envelope: Array
    ) -> tuple[Array, Array]:
        """Return left and right pixels (n, 2) of `targets` (n, 3) seen through the waves.

        `envelope` (n,) scales the waves at each of the `times` (n,). Pixels are relative to the
        principal point, and nan where the target has no single image (a focus lies in between).
        """
        left = self._seen(targets, times, waves, envelope, 0.0)
        right = self._seen(targets, times, waves, envelope, self.baseline)
        return left, right

    def triangulate(self, left: Array, right: Array) -> Array:
        """Return the points (n, 3) midway between the rays of pixels (n, 2) in flat water."""
        start_l, ray_l = self._into_flat_water(left, 0.0)
        start_r, ray_r = self._into_flat_water(right, self.baseline)
        apart = start_r - start_l
        cosine = np.sum(ray_l * ray_r, axis=1)
        along_l, along_r = np.sum(apart * ray_l, axis=1), np.sum(apart * ray_r, axis=1)
        denominator = 1.0 - cosine * cosine
        reach_l = (along_l - cosine * along_r) / denominator
        reach_r = (cosine * along_l - along_r) / denominator
        return 0.5 * (start_l + reach_l[:, None] * ray_l + start_r + reach_r[:, None] * ray_r)

    def covariance(self, left: Array, right: Array, pixel_std: float) -> Array:
        """Return the covariances (n, 3, 3) of the points for independent pixel noise (px)."""
        step = 0.05
        columns = []
        for number in range(4):
            shift = np.zeros(4)
            shift[number] = step
            ahead = self.triangulate(left + shift[:2], right + shift[2:])
            behind = self.triangulate(left - shift[:2], right - shift[2:])
            columns.append((ahead - behind) / (2.0 * step))
        jacobian = pixel_std * np.stack(columns, axis=2)
        return np.einsum('nij,nkj->nik', jacobian, jacobian)

    def media(
        self,
        stamps: Array,
        left: Array,
        right: Array,
        positions: Array,
        covariances: Array,
        pixel_std: float,
    ) -> Array:
        """Return the covariances (n, 3, 3) by waves, as the triangulator follows them, m^2."""
        rig = self.rig
        noise = pixel_std**2 * np.eye(2)
        found = triangulate(rig, left, right, noise, noise)
        meter, media, newest = MediumMeter(rig), np.empty((len(stamps), 3, 3)), np.zeros((3, 3))
        for number, residuals in enumerate(found.residuals):
            seen = np.isfinite(residuals).all() and np.abs(residuals).max() < LARGEST_MISS
            if seen:
                newest = meter.add(
                    float(stamps[number]),
                    residuals,
                    (noise, noise),
                    positions[number],
                    covariances[number],
                ).short
            media[number] = newest
        return media

    def _into_flat_water(self, pixels: Array, camera_x: float) -> tuple[Array, Array]:
        """Return entry points and unit rays in the water (n, 3), by Snell's law."""
        ray = np.column_stack([pixels / self.focal_length, np.ones(len(pixels))])
        start = ray * self.surface + np.array([camera_x, 0.0, 0.0])
        across = ray[:, :2] / (self.index * np.linalg.norm(ray, axis=1))[:, None]
        down = np.sqrt(1.0 - np.sum(across * across, axis=1))
        return start, np.column_stack([across, down])

    def _seen(
        self, targets: Array, times: Array, waves: WaveField, envelope: Array, camera_x: float
    ) -> Array:
        flat = _stationary(
            lambda at: self._path_slope(targets, camera_x, at, np.zeros((len(at), 3))),
            targets[:, :2] + 0.6 * (np.array([camera_x, 0.0]) - targets[:, :2]),
        )

        def slope(at: Array) -> Array:
            shape = waves.height_and_slope(at[:, 0], at[:, 1], times)
            return self._path_slope(targets, camera_x, at, envelope[:, None] * np.stack(shape, 1))

        entry = _stationary(slope, flat)
        height = envelope * waves.height_and_slope(entry[:, 0], entry[:, 1], times)[0]
        across = entry - np.array([camera_x, 0.0])
        return self.focal_length * across / (self.surface - height)[:, None]

    def _path_slope(self, targets: Array, camera_x: float, at: Array, shape: Array) -> Array:
        """Return the derivative (n, 2) of the optical path along the surface at `at` (n, 2).

        `shape` (n, 3) holds the surface's height towards the cameras and its slopes along x and y.
        """
        entry = np.column_stack([at, self.surface - shape[:, 0]])
        above = entry - np.array([camera_x, 0.0, 0.0])
        below = targets - entry
        bend = above / np.linalg.norm(above, axis=1, keepdims=True) - (
            self.index * below / np.linalg.norm(below, axis=1, keepdims=True)
        )
        return bend[:, :2] - shape[:, 1:] * bend[:, 2:]


def _stationary(slope: Callable[[Array], Array], start: Array) -> Array:
    """Return where `slope` (n, 2) of points (n, 2) vanishes, by Newton; nan where it does not."""
    at = start
    step = 1e-6
    value = slope(at)
    for _ in range(_ITERATIONS):
        along_x = (slope(at + np.array([step, 0.0])) - value) / step
        along_y = (slope(at + np.array([0.0, step])) - value) / step
        hessian = np.stack([along_x, along_y], axis=2)
        move = -np.linalg.solve(hessian, value[:, :, None])[:, :, 0]
        length = np.linalg.norm(move, axis=1, keepdims=True)
        at = at + move * np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-300))
        value = slope(at)
        if np.all(np.abs(value) < _TOLERANCE):
            break
    lost = np.any(np.abs(value) > 1e3 * _TOLERANCE, axis=1)
    return np.where(lost[:, None], np.nan, at)
