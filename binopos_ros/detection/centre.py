"""The centre of a target's outline to a few hundredths of a pixel, and its covariance.

The centre is that of the area within the outline. Each pixel counts by the share of it that the
target covers: its colour is projected on the line from the surroundings' colour to the target's,
where 0 is the one and 1 the other. Both are planes fitted to this image around and inside the
outline, so neither a threshold nor a slope of the light shifts the centre, and blur, which is as
wide on all sides, shifts nothing either. Well inside the outline the share is 1, well outside it
is 0; only the band between is measured, and only its noise reaches the centre.

The covariance comes from what the band's pixels leave over when the mean profile across the edge
is taken away, with the correlation of neighbouring pixels that demosaicing, JPEG and chroma
subsampling bring about.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .images import Frame
from .target import Array, Ellipse

BAND = 5.0
RING = 6.0
BIN = 0.25
CORRELATION = 4

Grid = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Centre:
    """A measured outline: its ellipse and diameter in px, the centre's covariance in px^2."""

    outline: Ellipse
    covariance: Array
    diameter: float


def measure(frame: Frame, seed: Ellipse) -> Centre:
    """Measure the outline near a seed that lies within a few pixels of it.

    Raises DetectionError where no outline can be measured there.
    """
    first = _Cover(frame, seed).outline()
    second = _Cover(frame, first).outline()
    # Two seeds of the same target agree by now to much less than the steps they are rounded to,
    # so the last pass starts from one and the same outline however the target was found.
    return _Cover(frame, _rounded(second)).centre()


def _rounded(ellipse: Ellipse) -> Ellipse:
    axes = np.sqrt(np.diag(ellipse.moments))
    tilt = ellipse.moments[0, 1] / axes.prod()
    axes, tilt = (
        np.maximum(np.round(axes * 4), 1) / 4,
        np.clip(np.round(tilt * 8) / 8, -0.875, 0.875),
    )
    cross = tilt * axes.prod()
    moments = np.array([[axes[0] ** 2, cross], [cross, axes[1] ** 2]])
    return Ellipse(np.round(ellipse.centre * 2) / 2, moments)


class _Cover:
    """The share of each pixel about an outline that the target covers."""

    def __init__(self, frame: Frame, around: Ellipse) -> None:
        reach = 2 * np.sqrt(np.diag(around.moments)) + BAND + RING
        low = np.maximum(np.floor(around.centre - reach), 0).astype(int)
        high = np.minimum(
            np.ceil(around.centre + reach).astype(int) + 1, (frame.width, frame.height)
        )
        if (high - low).min() < 4:
            msg = 'the outline lies outside of the image'
            raise DetectionError(msg)
        self._low = low
        pixels = frame.window(*low.tolist(), *high.tolist()).astype(np.float32)
        self._around = around
        self._x = np.arange(low[0], high[0], dtype=np.float32) - np.float32(around.centre[0])
        self._y = np.arange(low[1], high[1], dtype=np.float32) - np.float32(around.centre[1])
        self._outer = self._within(BAND)
        ring = self._within(BAND + RING) & ~self._outer
        self._core = self._within(-BAND)
        inside = self._core if self._core.sum() >= 32 else self._within(0, 0.7)
        if ring.sum() < 16 or inside.sum() < 3:
            msg = 'too few pixels in or about the outline'
            raise DetectionError(msg)
        background = np.array(cv2.mean(pixels, ring.view(np.uint8))[:3])
        axis = np.array(cv2.mean(pixels, inside.view(np.uint8))[:3]) - background
        power = float(axis @ axis)
        if power < 9.0:
            msg = 'the patch is of the same colour as its surroundings'
            raise DetectionError(msg)
        row = np.append(axis, -axis @ background) / power
        share = np.asarray(cv2.transform(pixels, row[None].astype(np.float32)), np.float32)
        share = share - self._plane(share, ring)
        if self._core.sum() >= 32:
            share /= self._plane(share, self._core)
        self._share: Grid = share
        self._ring = ring
        self._sum_up()

    def _within(self, margin: float, scale: float = 1.0) -> npt.NDArray[np.bool_]:
        """The pixels within the outline, its semi-axes times `scale` plus `margin` px."""
        values, vectors = np.linalg.eigh(self._around.moments)
        axes = 2 * np.sqrt(np.maximum(values, 0)) * scale + margin
        if axes[0] <= 0.5:
            return np.zeros((self._y.size, self._x.size), bool)
        (a, b), (_, d) = ((vectors / axes**2) @ vectors.T).astype(np.float32)
        x, y = self._x, self._y
        return (a * x * x + (d * y * y)[:, None]) + (2 * b * y)[:, None] * x < 1

    def _plane(self, values: Grid, where: npt.NDArray[np.bool_]) -> Grid:
        """Fit a plane to the values at some pixels, but for those that stand apart."""
        some = values[where]
        middle = np.median(some)
        spread = 4.5 * np.median(np.abs(some - middle)) + 0.02
        weights = (where & (np.abs(values - middle) < spread)).astype(np.float32)
        n, first, second = _moments(weights, self._x, self._y)
        value, slope, _ = _moments(weights * values, self._x, self._y)
        normal = np.array(
            [
                [n, first[0], first[1]],
                [first[0], second[0], second[2]],
                [first[1], second[2], second[1]],
            ]
        )
        normal[1, 1] += 1e-3 * n
        normal[2, 2] += 1e-3 * n
        c, cx, cy = np.linalg.solve(normal, np.array([value, *slope])).astype(np.float32)
        return (c + cy * self._y)[:, None] + cx * self._x

    def _sum_up(self) -> None:
        self._counted = np.where(self._core, np.float32(1), self._share) * self._outer
        area, first, second = _moments(self._counted, self._x, self._y)
        if not area > 4:
            msg = 'no area is left within the outline'
            raise DetectionError(msg)
        offset = first / area
        spread = np.array([[second[0], second[2]], [second[2], second[1]]]) / area
        spread -= np.outer(offset, offset)
        if not (spread[0, 0] > 0.1 and spread[1, 1] > 0.1 and np.linalg.det(spread) > 0.01):
            msg = 'the area within the outline has no width'
            raise DetectionError(msg)
        self._area, self._offset, self._spread = area, offset, spread

    def outline(self) -> Ellipse:
        return Ellipse(self._around.centre + self._offset, self._spread)

    def centre(self) -> Centre:
        outline = self.outline()
        values = np.linalg.eigvalsh(self._spread)
        diameter = 4 * float(np.sqrt(values[1]))
        return Centre(outline, self._covariance(outline), diameter)

    def _covariance(self, outline: Ellipse) -> Array:
        x, y = self._x - np.float32(self._offset[0]), self._y - np.float32(self._offset[1])
        inverse = np.linalg.inv(4 * outline.moments).astype(np.float32)
        gu = inverse[0, 0] * x + (inverse[0, 1] * y)[:, None]
        gv = inverse[0, 1] * x + (inverse[1, 1] * y)[:, None]
        t = np.sqrt(gu * x + gv * y[:, None])
        distance = (t - 1) * t / np.sqrt(gu * gu + gv * gv + 1e-12)
        measured = self._outer & ~self._core
        place = ((distance[measured] + 2 * BAND) / BIN).astype(np.intp)
        place = np.clip(place, 0, int(4 * BAND / BIN))
        share = self._share[measured]
        count = np.bincount(place)
        profile = np.bincount(place, share) / np.maximum(count, 1)
        rest = np.zeros_like(self._share)
        rest[measured] = share - profile[place]
        scale = np.float32(1 / self._area)
        ru, rv = rest * (x * scale), rest * (y * scale)[:, None]
        kernel = (
            1 - np.abs(np.arange(-CORRELATION + 1, CORRELATION, dtype=np.float32)) / CORRELATION
        )
        su, sv = (
            cv2.sepFilter2D(r, -1, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
            for r in (ru, rv)
        )
        cross = float((ru * sv).sum())
        covariance = np.array([[float((ru * su).sum()), cross], [cross, float((rv * sv).sum())]])
        return covariance


def _moments(weights: Grid, x: Grid, y: Grid) -> tuple[float, Array, Array]:
    """The weights' sum, their first moments (x, y) and second ones (xx, yy, xy)."""
    columns = weights.sum(0, dtype=np.float64)
    rows = weights.sum(1, dtype=np.float64)
    first = np.array([columns @ x, rows @ y])
    second = np.array([columns @ (x * x), rows @ (y * y), y @ weights @ x])
    return float(columns.sum()), first, second
