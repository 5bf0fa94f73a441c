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

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from .errors import DetectionError
from .images import Frame
from .jpeg import CHROMA_ERROR, LUMA_ERROR
from .profiles import PROFILE_REACH, PROFILE_STEPS, depths, profiles
from .target import Array, Ellipse
from .terms import (
    BENDS,
    BLUR,
    BLURS,
    DEPTH,
    FLAT_TERMS,
    INSIDE,
    LIKELY,
    LIKELY_SHADE,
    LIKELY_SLOPES,
    MOTION,
    OUTSIDE,
    SHADED_TERMS,
    SHEAR,
    SLOPES,
    STRETCH,
    TERMS,
    TURNS,
)
from .window import Grid, Window

BAND = 6.0
LEAST_PIXELS = 48
FIRST_NOISE = 1e-4
START_BLUR, LEAST_BLUR, MOST_BLUR = 0.9, 0.3, 3.0

SHARED_NOISE = 0.01
"""Part of equal noise in all channels that is mixed into the noise found along the edge."""

LUMA_FACTOR, CHROMA_FACTOR = 0.4, 7.0
"""How much of JPEG's rounding the channels' weights allow for, beside what the residuals show
(rendered discs of 8 to 120 px, quality 70 to 95, 4:2:0)."""

UNSEEN = 0.3
"""Share of that which follows the picture, so that the fit of a flat target takes it for outline
and no wave of the residuals shows it. A shaded one's, of twice the terms, takes all of it."""

SHADED = 0.12
"""From which slope of its own light on, over its radius and as a share of its contrast, a target
is taken for a body: its surface turns away from the lamp. A flat one is fitted without that."""

LEAST_BODY = 5.0
"""px of the minor semi-axis from which on there is room for them."""

AT_ONCE = 250_000
"""Multiplications in one product: so few BLAS does not hand to other threads, which on a busy
machine take longer to answer than to compute."""

NEAR, MOST_STEPS = 0.1, 5
"""A step of fewer px is the last, and there are no more than so many."""

MOST_MOVE, MOST_STRETCH, MOST_BLUR_CHANGE = 2.0, 0.3, 0.4
"""How far a step may go: px, share of the axes, px."""

LEAST_LOCAL = 0.15
"""Least contrast along the outline, as a share of its mean, that a place may have."""

FIRST_WAVE, LEAST_WAVES, MOST_WAVES = 3, 5, 14
"""The fit takes up the waves about the outline before the first: size, centre and axes. Of those
from there on, so many at the least and at the most tell how strong they are."""

SHORTEST_WAVE = 8.0
"""px along the outline of the shortest wave, but for the least number of them: a JPEG's block."""


@dataclass(frozen=True)
class Measured:
    """A measured outline, and its centre's covariance (2, 2) px^2."""

    outline: Ellipse
    covariance: Array


class EdgeFit:
    """The fit, begun at an outline that is right to some tenths of a pixel.

    sectors, equal ones by direction from the u axis on, tell where the outline is seen; without
    them it is seen everywhere. Raises DetectionError where there are too few pixels, or no two
    colours.
    """

    def __init__(
        self, frame: Frame, start: Ellipse, sectors: npt.NDArray[np.bool_] | None = None
    ) -> None:
        window = Window(frame, start, BAND)
        band = window.within(BAND) - window.within(-BAND)
        places = np.flatnonzero(band.view(np.bool_))
        if sectors is not None:
            places = places[window.lie_in(places, start.centre, sectors)]
        count = places.size
        if count < LEAST_PIXELS:
            msg = 'too few pixels along what is seen of the outline'
            raise DetectionError(msg)
        self._width = band.shape[1]
        self._rows = places // self._width
        self._columns = places - self._rows * self._width
        self._origin, self._centre = start.centre.tolist(), (0.0, 0.0)
        self._xy = np.empty((2, count), np.float32)
        self._xy[0], self._xy[1] = self._columns, self._rows
        self._xy -= _column(self._origin[0] - window.left, self._origin[1] - window.top)
        (a, b), (_, d) = start.moments.tolist()
        self._moments, self._blur = (a, b, d), START_BLUR
        # The edge's slope, the terms, and below them what is fitted by them: one product gives
        # both sides of the normal equations, and of different factors, which is three times as
        # fast as of equal ones.
        self._contrast: Grid | None = None
        self._rows_of_all = np.empty((1 + TERMS + 3, count), np.float32)
        self._slope = self._rows_of_all[0]
        pixels = window.pixels.reshape(-1, 3).take(places, 0).T
        self._model(FLAT_TERMS, pixels)
        self._likely = LIKELY + (a + d) * LIKELY_SLOPES
        luma, chroma = frame.rounding
        self._rounding = LUMA_FACTOR * luma * LUMA_ERROR + CHROMA_FACTOR * chroma * CHROMA_ERROR
        rest = self._solve(FIRST_NOISE)
        is_shaded = self._is_shaded(start)
        axis = self._choose_axis(rest, self._shading(start) if is_shaded else None)
        solution = self._solution @ axis
        if is_shaded:
            self._contrast = self._contrast_along(solution)
        self._move(solution)
        row = axis.astype(np.float32) @ pixels
        # Shared colour is the more blurred: as its share in the contrast, so the blur changes.
        shaded = TERMS if chroma else SHADED_TERMS
        self._model(shaded if is_shaded else FLAT_TERMS, row[None])
        for _ in range(MOST_STEPS):
            self._left = self._solve(self._noise)[0]
            if self._move(self._solution[:, 0]) < NEAR:
                break

    def _model(self, terms: int, pixels: Grid) -> None:
        """Make room for so many terms, and below them for what is fitted by them."""
        self._design = self._rows_of_all[1 : 1 + terms]
        self._system = self._rows_of_all[1 : 1 + terms + len(pixels)]
        self._system[terms:] = pixels

    def _is_shaded(self, start: Ellipse) -> bool:
        """Whether the light on the target itself slopes as it does on a body."""
        difference = self._solution[INSIDE] - self._solution[OUTSIDE]
        slopes = self._solution[SLOPES.start : SLOPES.start + 2]
        major, minor = start.semi_axes
        change = math.sqrt(float((slopes * slopes).sum() / (difference @ difference))) * major
        return minor >= LEAST_BODY and change > SHADED

    def _shading(self, start: Ellipse) -> Array:
        """How the target's contrast changes, by channel, over its radius, where it does most."""
        own, outside = self._solution[SLOPES].reshape(2, 2, 3)
        (xx, xy), (_, yy) = (own @ own.T).tolist()
        angle = math.atan2(2 * xy, xx - yy) / 2
        towards = start.semi_axes[0] * np.array([math.cos(angle), math.sin(angle)])
        change: Array = towards @ (own - outside)
        return change

    def _solve(self, noise: float) -> Grid:
        """Solve, for each row below the terms, for the edge's motion and the two planes.

        noise is the variance of the rows as a share of the contrast. Gives what is left over.
        """
        design, system = self._design, self._system
        self._set_terms()
        terms, count = design.shape
        products = np.zeros((terms, len(system)))
        step = AT_ONCE // (terms * len(system))
        for k in range(0, count, step):
            some = slice(k, k + step)
            products += design[:, some] @ system[:, some].T
        normal = products[:, :terms].copy()
        normal.ravel()[:: terms + 1] += noise * self._likely[:terms] + 1e-9
        regular, self._inverse = cv2.invert(normal, flags=cv2.DECOMP_CHOLESKY)
        if not regular:
            msg = 'the pixels along the outline do not determine it'
            raise DetectionError(msg)
        self._solution: Array = self._inverse @ products[:, terms:]
        rest: Grid = system[terms:] - self._solution.T.astype(np.float32) @ design
        return rest

    def _set_terms(self) -> None:
        design = self._design
        xy = self._xy - _column(*self._centre)
        a, b, d = _inverse(*self._moments)
        gradient = np.array([[a / 4, b / 4], [b / 4, d / 4]], np.float32) @ xy
        t, steep = np.sqrt(_sum_of_rows(gradient * xy)), np.sqrt(_sum_of_rows(gradient * gradient))
        z = t - 1
        z *= t
        z /= steep
        z *= np.float32(PROFILE_STEPS / self._blur)
        z += np.float32(PROFILE_REACH * PROFILE_STEPS + 0.5)
        # By a table: a third of the time of exponentials.
        places = z.astype(np.intp)
        by_distance = self._rows_of_all[: 2 + OUTSIDE]
        profiles().take(places, 1, by_distance, 'clip')
        scale: Grid | np.float32 = np.float32(1 / self._blur)
        by_distance[:4] *= scale if self._contrast is None else scale * self._contrast
        gradient /= steep
        self._normal = gradient
        np.multiply(gradient, self._slope, out=design[MOTION])
        np.multiply(design[MOTION], xy, out=design[STRETCH])
        _sum_of_rows(design[MOTION] * xy[::-1], out=design[SHEAR])
        slopes = design[SLOPES].reshape(2, 2, -1)
        np.multiply(by_distance[4:, None], xy, out=slopes)
        if self._contrast is None:
            return
        # The blur goes over the colours too: what slopes is carried across the outline by it.
        carried = np.float32(self._blur**2) / self._contrast * design[MOTION]
        slopes[0] -= carried
        slopes[1] += carried
        # A ball's surface turns away towards its outline, and its lit side bends with it.
        depths().take(places, 0, design[DEPTH], 'clip')
        t += 1
        steep *= t
        steep /= t - 1
        steep *= np.float32(self._blur)
        design[DEPTH] *= np.sqrt(steep, out=steep)
        squared = np.float32(2 * (self._moments[0] + self._moments[2]))
        np.multiply(design[DEPTH] / np.sqrt(squared), xy, out=design[TURNS])
        inside = design[INSIDE] / squared
        np.multiply(inside, (xy[0] - xy[1]) * (xy[0] + xy[1]), out=design[BENDS.start])
        np.multiply(inside * xy[0], xy[1], out=design[BENDS.start + 1])
        if len(design) == TERMS:
            np.multiply(design[BLUR], self._normal, out=design[BLURS])

    def _contrast_along(self, solution: Array) -> Grid:
        """The contrast to the surroundings at each pixel, as a share of its mean."""
        terms = solution.astype(np.float32)
        slopes = terms[SLOPES].reshape(2, 2)
        contrast = (slopes[0] - slopes[1]) @ self._xy
        contrast += terms[INSIDE] - terms[OUTSIDE]
        return np.clip(contrast, LEAST_LOCAL, None, out=contrast)

    def _choose_axis(self, rest: Grid, change: Array | None) -> Array:
        """The projection of colours, 1 from surroundings to target, that errs least.

        `change` (3,) is what the light makes of a shaded target's contrast over its radius.
        Leaves, of the rest along it, the variance, and that of rounding.
        """
        difference = self._solution[INSIDE] - self._solution[OUTSIDE]
        if not difference @ difference > 9.0:
            msg = 'the patch is of the same colour as its surroundings'
            raise DetectionError(msg)
        influence = self._inverse[MOTION].astype(np.float32) @ self._design
        weight = _sum_of_rows(influence * influence)
        sums = self._sums_over_blocks((np.sqrt(weight) * rest).astype(float))
        noise = sums + float(weight.sum()) * self._rounding
        noise.ravel()[::4] += SHARED_NOISE * sum(sums.ravel()[::4].tolist()) + 1e-12
        if change is not None:
            # What of the shading no term follows counts as noise in its colours.
            noise += float(weight.sum()) * LIKELY_SHADE**2 * np.outer(change, change)
        row = cv2.solve(noise, difference[:, None], flags=cv2.DECOMP_CHOLESKY)[1].ravel()
        axis: Array = row / (row @ difference)
        left = axis.astype(np.float32) @ rest
        squared = left * left
        self._hidden = float(axis @ self._rounding @ axis)
        self._noise = 2.5 * float(squared.sum()) / left.size + self._hidden
        return axis

    def _sums_over_blocks(self, values: Array) -> Array:
        """Products of the sums over blocks, (n, n), of values (n, N) at the band's pixels.

        The blocks, of 4 x 4 pixels, lie at all even places, so four of them cover each pixel; the
        mean over these is taken. Such products are never negative, whatever the residuals.
        """
        across, down = (self._width >> 1) + 3, (int(self._rows[-1]) >> 1) + 3
        cells = (self._rows >> 1) * across
        cells += self._columns >> 1
        cells += across + 1
        grids = np.array([np.bincount(cells, each, across * down) for each in values])
        grids = grids.reshape(-1, down, across)
        pairs = grids[:, :-1] + grids[:, 1:]
        blocks = (pairs[..., :-1] + pairs[..., 1:]).reshape(len(values), -1)
        products: Array = blocks @ (blocks / 4).T
        return products

    def _move(self, solution: Array) -> float:
        """Move the outline, and give how far its centre went, px."""
        blur, _, _, _, _, du, dv, su, sv, suv = solution[: SHEAR + 1].tolist()
        du, dv = _limited(du, MOST_MOVE), _limited(dv, MOST_MOVE)
        su, sv, suv = (_limited(each, MOST_STRETCH) for each in (su, sv, suv))
        blur = _limited(blur, MOST_BLUR_CHANGE)
        self._centre = self._centre[0] + du, self._centre[1] + dv
        a, b, d = self._moments
        # The stretch (1 + su, suv; suv, 1 + sv) from both sides.
        p, q = (1 + su) * a + suv * b, (1 + su) * b + suv * d
        r, s = suv * a + (1 + sv) * b, suv * b + (1 + sv) * d
        self._moments = p * (1 + su) + q * suv, p * suv + q * (1 + sv), r * suv + s * (1 + sv)
        self._blur = min(max(self._blur + blur, LEAST_BLUR), MOST_BLUR)
        return math.hypot(du, dv)

    def measured(self) -> Measured:
        """Give the outline that the fit ended at."""
        (u, v), (du, dv), (a, b, d) = self._origin, self._centre, self._moments
        outline = Ellipse(np.array([u + du, v + dv]), np.array([[a, b], [b, d]]))
        if not (math.isfinite(u + du + v + dv) and outline.semi_axes[1] > 0.5):
            msg = 'the fit of the outline came to nothing'
            raise DetectionError(msg)
        return Measured(outline, self._covariance())

    def _covariance(self) -> Array:
        """The centre's covariance: that of white noise as strong as the residuals' waves are."""
        unseen = UNSEEN if self._contrast is None else 1.0
        variance = self._waves() + unseen * self._hidden + 1e-12
        covariance: Array = self._inverse[MOTION, MOTION] * variance
        if self._contrast is None:
            return covariance
        # The shading is a series that ends here: what is left out is taken to be as large as the
        # last of what is in, by how far that shifts the centre.
        last = np.linalg.solve(self._inverse[BENDS, BENDS], self._solution[BENDS, 0])
        shift = self._inverse[MOTION, BENDS] @ last
        covariance += np.outer(shift, shift)
        return covariance

    def _waves(self) -> float:
        """The variance of the residuals' waves about the outline, as if of white noise.

        Whatever is left over along the outline, be it noise that neighbours share, ground that is
        uneven or a model that does not fit, has waves of all lengths; those that shift the centre
        are taken up by the fit, their neighbours are not. The longer ones, which are nearer to
        these, count for more. What has the same sign on all sides of the outline, or another on
        the outline's other side, is no wave of its motion and does not count.
        """
        radius = math.sqrt(2 * (self._moments[0] + self._moments[2]))
        most = int(2 * math.pi * radius / SHORTEST_WAVE) - FIRST_WAVE + 1
        count = min(max(most, LEAST_WAVES), MOST_WAVES)
        normal = np.empty(self._left.size, np.complex64)
        normal.real, normal.imag = self._normal
        waves = normal * normal
        waves *= self._slope * self._left
        power = weights = squares = 0.0
        for k in range(FIRST_WAVE, FIRST_WAVE + count):
            waves *= normal
            power += abs(waves.sum()) ** 2 / k
            weights += 1 / k
            squares += 1 / k**2
        # Of a variance that is itself estimated, of so many degrees of freedom, the inverse is
        # too large by this.
        free = 2 * weights**2 / squares
        total = float(self._slope @ self._slope) * weights
        return float(power) / total * free / (free - 2)


def _limited(value: float, most: float) -> float:
    return min(max(value, -most), most)


def _column(first: float, second: float) -> Grid:
    return np.array([[first], [second]], np.float32)


def _sum_of_rows(pair: Grid, out: Grid | None = None) -> Grid:
    total: Grid = np.add(pair[0], pair[1], out=out)
    return total


def _inverse(a: float, b: float, d: float) -> tuple[float, float, float]:
    """The inverse of a symmetric matrix (2, 2), both as xx, xy and yy."""
    determinant = a * d - b * b
    return d / determinant, -b / determinant, a / determinant
