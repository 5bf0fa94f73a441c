"""The fit of an outline to the pixels along it: the centre to a few hundredths of a pixel.

Each pixel of a band along the outline is modelled as a mixture of two colours, the target's and
its surroundings', both planes over the image, with the share Phi(-d / s) of the target at a
distance d outside of an ellipse, where s is the blur. Two more terms, of the third and the fourth
derivative of that profile, take up what an edge has of another shape. Ellipse, blur, profile and
planes come out of one least-squares fit, so there is no threshold to bias it, and a slope of the
light does not shift it.

All channels are fitted; the edge's motion is then read off along one axis of colours: the
difference of the two colours, weighted against the noise that each channel shows along the edge.
So chroma counts for less in a JPEG, where it is coarser.

The covariance comes from what the fit leaves over, with the correlation of neighbouring pixels
that demosaicing, JPEG and chroma subsampling bring about.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from .errors import DetectionError
from .images import Frame
from .target import Array, Ellipse
from .window import Window

BAND = 5.0
STEPS = 1
LEAST_PIXELS = 48
START_BLUR, LEAST_BLUR, MOST_BLUR = 0.9, 0.3, 3.0

# What is likely before the fit, as standard deviations (stretch as a share of the axes, blur in
# px, profile and slope as shares of the contrast). It steadies outlines of a few pixels.
LIKELY_STRETCH = 0.02
LIKELY_BLUR = 0.2
LIKELY_PROFILE = 0.05
LIKELY_SLOPE = 0.05

SHARED_NOISE = 0.01
"""Part of equal noise in all channels that is mixed into the noise found along the edge."""

BLOCK = 4
"""Neighbouring residuals count as correlated by the share of pixels that two blocks of this side
about them have in common. Products of sums over blocks are never negative, whatever the residuals;
other weights can be, where residuals alternate, as those of subsampled chroma do."""

RETURNED = 0.5
"""Share of the fit's mean leverage by which neighbours' residuals are too little correlated."""

LEAST_FACTOR = 0.8
JPEG_FACTOR = 2.3
"""JPEG's rounding follows the picture, so the fit takes a part of it for outline: residuals show
less than half of its variance (rendered discs of 8 to 120 px, quality 70 to 95)."""

# The model's terms, by their rows.
U, V, STRETCH, BLUR, PROFILE = 0, 1, slice(2, 5), 5, slice(6, 8)
INSIDE, INSIDE_SLOPE, OUTSIDE, OUTSIDE_SLOPE = 8, slice(9, 11), 11, slice(12, 14)
TERMS = 14

MOST_MOVE = (2.0, 2.0, 0.3, 0.3, 0.3, 0.4)
"""How far a step may go: px, px, three stretches as shares of the axes, blur in px."""

_PEAK = 1 / np.sqrt(2 * np.pi)
FAR = np.float32(6)
# The normal distribution as a logistic one of a cubic, good to 2e-4 (Page 1977).
_PHI_1, _PHI_3 = 1.5976, 0.070565992


@dataclass(frozen=True)
class Measured:
    """A measured outline, and its centre's covariance (2, 2) px^2."""

    outline: Ellipse
    covariance: Array


class EdgeFit:
    """The fit, begun at an outline that is right to some tenths of a pixel.

    Raises DetectionError where there are too few pixels, or no two colours.
    """

    def __init__(self, frame: Frame, start: Ellipse) -> None:
        window = Window(frame, start, BAND)
        self._band = window.within(BAND) ^ window.within(-BAND)
        band = np.flatnonzero(self._band)
        if band.size < LEAST_PIXELS:
            msg = 'too few pixels along the outline'
            raise DetectionError(msg)
        self._rows, self._columns = np.divmod(band, self._band.shape[1])
        self._u = window.x[self._columns]
        self._v = window.y[self._rows]
        self._colours = np.ascontiguousarray(window.pixels.reshape(-1, 3).take(band, 0).T)
        self._jpeg = frame.is_jpeg
        self._origin, self._centre = start.centre, np.zeros(2)
        self._moments, self._blur = start.moments, START_BLUR
        self._design = np.empty((TERMS, band.size), np.float32)
        self._likely = self._weights_of_the_likely()
        self._noise = 1e-4
        self._solve()
        axis = self._axis()
        self._noise = 2.5 * float(np.mean((axis @ self._rest) ** 2))
        for _ in range(STEPS):
            self._move(self._solution @ axis)
            self._solve()
        self._move(self._solution @ axis)
        self._left = axis.astype(np.float32) @ self._rest

    def _weights_of_the_likely(self) -> Array:
        weights = np.zeros(TERMS)
        weights[STRETCH] = LIKELY_STRETCH**-2
        weights[BLUR] = LIKELY_BLUR**-2
        weights[PROFILE] = LIKELY_PROFILE**-2
        size = float(np.trace(self._moments))
        weights[INSIDE_SLOPE] = weights[OUTSIDE_SLOPE] = size * LIKELY_SLOPE**-2
        return weights

    def _solve(self) -> None:
        """Solve, for each channel, for the edge's motion and the two planes."""
        du, dv = self._centre.tolist()
        x, y = self._u - np.float32(du), self._v - np.float32(dv)
        a, b, d = _inverse(4 * self._moments)
        gu, gv = a * x + b * y, b * x + d * y
        t = np.sqrt(gu * x + gv * y)
        steep = 1 / (np.sqrt(gu * gu + gv * gv) + np.float32(1e-9))
        z = (t - 1) * t * (steep * np.float32(1 / self._blur))
        np.minimum(np.maximum(z, -FAR, out=z), FAR, out=z)
        zz = z * z
        share = 1 / (1 + np.exp(z * (np.float32(_PHI_1) + np.float32(_PHI_3) * zz)))
        slope = np.exp(np.float32(-0.5) * zz) * np.float32(_PEAK / self._blur)
        steep *= slope
        design = self._design
        nu, nv = np.multiply(gu, steep, out=design[U]), np.multiply(gv, steep, out=design[V])
        np.multiply(nu, x, out=design[2])
        np.multiply(nv, y, out=design[3])
        np.add(nu * y, nv * x, out=design[4])
        np.multiply(z, slope, out=design[BLUR])
        np.multiply(zz - 1, slope, out=design[6])
        np.multiply(zz - 3, design[BLUR], out=design[7])
        design[INSIDE] = share
        rest = np.subtract(1, share, out=design[OUTSIDE])
        for first, share_of_side in ((INSIDE + 1, share), (OUTSIDE + 1, rest)):
            np.multiply(share_of_side, x, out=design[first])
            np.multiply(share_of_side, y, out=design[first + 1])
        normal = (design @ design.T).astype(float)
        normal.flat[:: TERMS + 1] += self._noise * self._likely + 1e-9
        regular, self._inverse = cv2.invert(normal, flags=cv2.DECOMP_CHOLESKY)
        if not regular:
            msg = 'the pixels along the outline do not determine it'
            raise DetectionError(msg)
        self._solution = self._inverse @ (design @ self._colours.T)
        self._rest = self._colours - self._solution.T.astype(np.float32) @ design

    def _axis(self) -> Array:
        """The projection of colours, 1 from surroundings to target, that errs least."""
        difference = self._solution[INSIDE] - self._solution[OUTSIDE]
        if not difference @ difference > 9.0:
            msg = 'the patch is of the same colour as its surroundings'
            raise DetectionError(msg)
        influence = self._inverse[:2].astype(np.float32) @ self._design
        sums = self._block_sums(np.sqrt((influence * influence).sum(0)) * self._rest)
        noise = (sums @ sums.T).astype(float)
        noise.flat[::4] += SHARED_NOISE * np.trace(noise) + 1e-12
        row = np.linalg.solve(noise, difference)
        axis: Array = row / (row @ difference)
        return axis

    def _block_sums(self, values: np.ndarray) -> np.ndarray:
        """Sums over all blocks, as a share of the side, of values (n, N) at the band's pixels."""
        height, width = (side + BLOCK for side in self._band.shape)
        # The grids lie one below the other, with zeros between them, so that one call does all.
        grids = np.zeros((len(values), height * width), np.float32)
        grids[:, (self._rows + BLOCK // 2) * width + self._columns + BLOCK // 2] = values
        sums = cv2.boxFilter(
            grids.reshape(-1, width),
            -1,
            (BLOCK, BLOCK),
            normalize=False,
            borderType=cv2.BORDER_CONSTANT,
        )
        return sums.reshape(len(values), -1) * np.float32(1 / BLOCK)

    def _move(self, solution: Array) -> None:
        du, dv, su, sv, suv, blur = (
            min(max(each, -most), most)
            for each, most in zip(solution[:6].tolist(), MOST_MOVE, strict=True)
        )
        self._centre = self._centre + np.array([du, dv])
        stretch = np.array([[1 + su, suv], [suv, 1 + sv]])
        self._moments = stretch @ self._moments @ stretch
        self._blur = min(max(self._blur + blur, LEAST_BLUR), MOST_BLUR)

    def measured(self) -> Measured:
        """Give the outline that the fit ended at."""
        outline = Ellipse(self._origin + self._centre, self._moments)
        if not (np.isfinite(outline.centre).all() and outline.semi_axes[1] > 0.5):
            msg = 'the fit of the outline came to nothing'
            raise DetectionError(msg)
        return Measured(outline, self._covariance())

    def _covariance(self) -> Array:
        """The centre's covariance from the residuals along the edge.

        That of white noise, times what the residuals' correlation makes of it. The fit takes a
        part of the noise with it, the more the smaller the outline; the pixels' leverage tells
        how much, and it is given back.
        """
        edge = self._design[:2]
        sums = self._block_sums(np.concatenate([edge, edge * self._left]))
        products = np.einsum('ij,ij->i', sums, sums).astype(float)
        weight = (edge * edge).sum(0)
        total = weight.sum()
        spread = (self._design * weight) @ self._design.T
        taken = float((self._inverse * spread).sum() / total)
        variance = float(weight @ (self._left**2)) / (total * max(1 - taken, 0.1)) + 1e-12
        given = RETURNED * taken * products[:2].sum()
        factor = max((products[2:].sum() / variance + given) / total, LEAST_FACTOR)
        if self._jpeg:
            factor *= JPEG_FACTOR
        covariance: Array = self._inverse[:2, :2] * (variance * factor)
        return covariance


def _inverse(matrix: Array) -> tuple[float, float, float]:
    """The inverse of a symmetric matrix (2, 2), as its xx, xy and yy."""
    (a, b), (_, d) = matrix.tolist()
    determinant = a * d - b * b
    return d / determinant, -b / determinant, a / determinant


_MOST_MOVE = np.array([2.0, 2.0, 0.3, 0.3, 0.3, 0.4])
