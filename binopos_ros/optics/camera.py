"""A camera with one centre and its lens: points to pixels and back (Eq. 1-3 of the paper).

The camera frame is the optical frame of REP-103: x right, y down, z forward. Pixels have the
centre of the upper-left pixel at (0, 0), as OpenCV and ROS have it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.optics.arithmetic import ARRAYS, Arithmetic, Component
from binopos_ros.optics.distortion import OUT_OF_FIELD
from binopos_ros.optics.errors import OpticsError
from binopos_ros.optics.lens import BROWN, LENSES, Lens

FloatArray = NDArray[np.float64]


class PinholeCamera:
    """A camera in one medium.

    Args:
        matrix: (3, 3) intrinsic matrix K (Eq. 3), pixels; K[0, 1] is the skew.
        distortion: 0, 4, 5, 8, 12 or 14 OpenCV terms (see `distortion.py`), or the four of an
            equidistant lens (see `equidistant.py`).
        size: image width and height, pixels.
        model: of the lens, 'brown' or 'equidistant'.

    Raises:
        OpticsError: the camera is uncalibrated (K all zero) or one of the three is impossible.

    Examples:
        >>> camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
        >>> camera
        PinholeCamera(f=(900, 900) px, centre=(640, 480) px, brown lens of 0 terms, 1280x960)
        >>> print(camera.project([[0.1, 0.0, 1.0], [0.0, 0.2, 2.0]]))
        [[730. 480.]
         [640. 570.]]

    """

    def __init__(
        self, matrix: ArrayLike, distortion: ArrayLike, size: ArrayLike, model: str = BROWN
    ) -> None:
        self.matrix = _intrinsic(matrix)
        if model not in LENSES:
            msg = f'there is no lens {model!r}: choose from {", ".join(LENSES)}'
            raise OpticsError(msg)
        self.lens: Lens = LENSES[model](distortion)
        self.size = _image_size(size)
        (self._fx, self._skew, self._cx), (_, self._fy, self._cy), _ = self.matrix.tolist()

    def __repr__(self) -> str:
        return (
            f'PinholeCamera(f=({self._fx:g}, {self._fy:g}) px, centre=({self._cx:g}, {self._cy:g})'
            f' px, {self.model} lens of {self.lens.coefficients.size} terms,'
            f' {self.size[0]}x{self.size[1]})'
        )

    @property
    def distortion(self) -> FloatArray:
        """The distortion terms as given, in OpenCV's order."""
        return self.lens.coefficients

    @property
    def model(self) -> str:
        """The name of the lens's model."""
        return self.lens.model

    def project(self, points: ArrayLike) -> FloatArray:
        """Project points of the camera frame, straight.

        Args:
            points: (N, 3) or (3,), any unit of length, or rays.

        Returns:
            (N, 2) or (2,) pixels; nan behind the camera and beyond the field where the radial
            distortion folds over. A pixel may lie outside the image.

        """
        points = components(points, 3, 'points')
        x, y, z = points[..., 0], points[..., 1], points[..., 2]
        with np.errstate(all='ignore'):
            x, y = self.ideal(x, y, z)
            return np.stack(self.pixels(x, y), axis=-1)

    def unproject(self, pixels: ArrayLike) -> FloatArray:
        """Return the unit rays of pixels, in the camera frame: the exact inverse of `project`.

        Args:
            pixels: (N, 2) or (2,).

        Returns:
            (N, 3) or (3,) unit vectors; nan where no ray of the lens's one-to-one field images.

        """
        pixels = components(pixels, 2, 'pixels')
        with np.errstate(all='ignore'):
            x, y = self.image_plane(pixels[..., 0], pixels[..., 1])
            length = np.sqrt(x * x + y * y + 1.0)
            return np.stack([x / length, y / length, 1.0 / length], axis=-1)

    def ideal(
        self, x: Component, y: Component, z: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Return the image-plane coordinates of a direction, kept to the lens's field."""
        z = arithmetic.keep(z, z > 0.0, self.lens.behind)
        x, y = x / z, y / z
        if self.lens.fold_radius_squared < math.inf:
            x = arithmetic.keep(x, self.lens.within_fold(x, y), OUT_OF_FIELD)
        return x, y

    def pixels(
        self, x: Component, y: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Put ideal image-plane coordinates on the sensor; the caller has checked the fold."""
        x, y = self.lens.distort(x, y, arithmetic)
        return self._fx * x + self._skew * y + self._cx, self._fy * y + self._cy

    def pixels_with_jacobian(
        self, x: Component, y: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component, Component, Component, Component, Component]:
        """Return u, v, and du/dx, du/dy, dv/dx, dv/dy."""
        x, y, xx, xy, yx, yy = self.lens.distort_with_jacobian(x, y, arithmetic)
        return (
            self._fx * x + self._skew * y + self._cx,
            self._fy * y + self._cy,
            self._fx * xx + self._skew * yx,
            self._fx * xy + self._skew * yy,
            self._fy * yx,
            self._fy * yy,
        )

    def image_plane(
        self, u: Component, v: Component, arithmetic: Arithmetic = ARRAYS
    ) -> tuple[Component, Component]:
        """Return the ideal image-plane coordinates of pixels; nan where there are none."""
        y = (v - self._cy) / self._fy
        return self.lens.undistort((u - self._cx - self._skew * y) / self._fx, y, arithmetic)


def components(values: ArrayLike, width: int, what: str) -> FloatArray:
    """Return `values` as floats with a last axis of `width`, or say what was expected."""
    array = np.asarray(values, dtype=float)
    if array.ndim not in (1, 2) or array.shape[-1] != width:
        msg = f'{what} must have the shape (N, {width}) or ({width},), not {array.shape}'
        raise OpticsError(msg)
    return array


def _intrinsic(matrix: ArrayLike) -> FloatArray:
    k = np.array(matrix, dtype=float)
    if k.shape != (3, 3):
        msg = f'the intrinsic matrix K must be 3x3, not {k.shape}'
        raise OpticsError(msg)
    if not k.any():
        msg = 'the camera is uncalibrated (K is all zero); run `binopos calibrate stereo` first'
        raise OpticsError(msg)
    if not np.isfinite(k).all():
        msg = f'the intrinsic matrix K holds a number that is not finite: {k.ravel().tolist()}'
        raise OpticsError(msg)
    if k[0, 0] <= 0.0 or k[1, 1] <= 0.0:
        msg = f'the focal lengths must be positive, not fx = {k[0, 0]:g}, fy = {k[1, 1]:g} px'
        raise OpticsError(msg)
    if k[1, 0] or k[2, 0] or k[2, 1] or not math.isclose(k[2, 2], 1.0):
        msg = 'the intrinsic matrix K must be upper triangular with K[2, 2] = 1'
        raise OpticsError(msg)
    k.flags.writeable = False
    return k


def _image_size(size: ArrayLike) -> tuple[int, int]:
    pair = np.asarray(size)
    if pair.shape != (2,) or not (pair > 0).all() or not (pair == np.floor(pair)).all():
        msg = f'the image size must be (width, height), two positive whole numbers, not {size!r}'
        raise OpticsError(msg)
    return int(pair[0]), int(pair[1])
