"""How the medium fluctuates: waves on a free surface, by the miss of the two rays.

Four pixels are measured for three coordinates, so each pair leaves one number, the rays' miss,
that tells nothing of where the target is, whatever it does. What pixel noise does not explain of
it is the medium's doing. The misses of late are the medium's cloud: their expectation is the
calibration's, their entropy the waves' (Eq. 22).

Short waves shift both images independently of each other, so they count as pixel noise would.
Waves that are long beside the distance of the rays at the surface shift both images alike, and
leave only a small part in the miss. How small, their frequency says: on deep water the wavenumber
is omega^2 / g (Lamb, Hydrodynamics, 6th ed., 1932, art. 229), and slopes of waves from all around
at two points D apart agree to

    c_across = <2 sin^2 t cos(k D cos t)>,    c_along = <2 cos^2 t cos(k D cos t)>

over the directions t. And the surface as a whole rises, which is depth without a miss: where a
target goes up and down slowly and no short waves show, it may be the water that does, and the
covariance covers both. What long waves do changes too slowly to be averaged away. Behind ports and
panes nothing waves.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from binopos_ros.optics import FlatInterface, StereoRig

Array = NDArray[np.float64]

#: Standard acceleration of gravity, m/s^2.
GRAVITY = 9.80665
#: Memory of the waves' level (s): a few periods of basins' waves. Of their frequency (s): a few
#: of the longest that show.
_LEVEL_MEMORY, _COLOUR_MEMORY = 1.0, 5.0
#: Misses further out than this, in their usual deviations, are shortened: one wrong pair is no
#: wave.
_FARTHEST = 4.0
#: Pairs without a mean miss that stand against the calibration's share in it.
_DOUBTED = 10.0
#: Slower than this (Hz) the misses are those of waves too long to shift the images independently.
#: The misses of basins' waves of 1.6 to 6 Hz come out at 3.3 Hz and more: slopes curve the most
#: where waves are short.
_LONG_WAVES = 2.5
#: Frames of a period by which waves are told from longer ones.
_FEWEST_FRAMES = 3.0
#: Slower waves (Hz) leave no miss that pixels show.
_SLOWEST = 0.5
#: Deviations of what chance adds to the misses' variance that are needed to tell a level or a
#: frequency, and pairs for the latter.
_SURE, _LEAST_PAIRS = 3.0, 20.0
#: Over this time (s) heights are compared, or from frame to frame where that is longer: a small
#: part of the period of waves that are long.
_LAG = 0.2
#: Over this time (s) misses are: a quarter of the period of the quickest waves that are long, as
#: there likeness tells the frequency best.
_MISS_LAG = 0.25 / _LONG_WAVES
_MEAN_ABSOLUTE_TO_DEVIATION = math.sqrt(math.pi / 2.0)

_DIRECTIONS = (np.arange(16) + 0.5) * (math.pi / 32.0)
_COSINES = np.cos(_DIRECTIONS)
#: Of slopes at two points: across the line between them, and along it.
_LIKENESS = np.array([2.0 * np.sin(_DIRECTIONS) ** 2 / 16.0, 2.0 * _COSINES**2 / 16.0])

_NOTHING = np.zeros((3, 3))


class Fluctuation(NamedTuple):
    """What the medium adds to a position's covariance (3, 3), m^2.

    Attributes
    ----------
    short : (3, 3) array
        By waves that swing to and fro within the frames of a second.
    long : (3, 3) array
        By waves that are too slow to be averaged away.

    """

    short: Array
    long: Array


def may_wave(surface: FlatInterface | None) -> bool:
    """Tell whether the interface that both cameras look through may wave: its media touch."""
    return surface is not None and not surface.thicknesses


class _Delay:
    """A quantity as it was a lag before; where frames are rarer, in the last one."""

    def __init__(self, lag: float) -> None:
        self._lag = lag
        self._past: deque[tuple[float, float]] = deque()

    def older(self, stamp: float, value: float) -> tuple[float, float] | None:
        """Take a value in; return the one of a lag before, after its age (s); None at first."""
        past = self._past
        while len(past) > 1 and stamp - past[0][0] > self._lag:
            past.popleft()
        past.append((stamp, value))
        since = stamp - past[0][0]
        return (since, past[0][1]) if since >= 0.5 * self._lag else None


class _Heights:
    """How the target goes up and down slowly, which under a free surface may be the water's."""

    def __init__(self) -> None:
        self._delay = _Delay(_LAG)
        self._stamp: float | None = None
        self._count = self._seconds = self._lag = 0.0
        self._mean = self._product = self._square = 0.0

    def add(self, stamp: float, height: float, noise: float) -> tuple[float, float]:
        """Take one height in (m), with its variance; return the slow part's, and its frequency.

        Heights of different frames have no noise in common, so their product holds none but by
        chance: what there is less than that of is nothing.
        """
        self._compare(stamp, height)
        moved = max(self._square - 2.0 * noise, 0.0)
        variance = self._product + 0.5 * moved
        if self._count == 0.0 or variance < _SURE * noise / math.sqrt(self._count):
            return 0.0, 0.0
        turn = math.acos(max(1.0 - 0.5 * moved / variance, -1.0))
        frequency = max(turn / (2.0 * math.pi * self._lag), 1.0 / (2.0 * _COLOUR_MEMORY))
        # Few periods tell a variance badly: Student's, not Gauss's, with two degrees a period.
        return variance * (1.0 + 2.0 / (frequency * self._seconds)), frequency

    def _compare(self, stamp: float, height: float) -> None:
        elapsed = 0.0 if self._stamp is None else stamp - self._stamp
        self._stamp = stamp
        compared = self._delay.older(stamp, height)
        if compared is None:
            return
        lag, older = compared
        fading = math.exp(-elapsed / _COLOUR_MEMORY)
        self._count = self._count * fading + 1.0
        self._seconds = self._seconds * fading + elapsed
        gain = 1.0 / self._count
        self._lag += gain * (lag - self._lag)
        self._mean += gain * (height - self._mean)
        rise, before = height - self._mean, older - self._mean
        self._product += gain * (rise * before - self._product)
        self._square += gain * ((rise - before) ** 2 - self._square)


class MediumMeter:
    """Follows the waves' level from pair to pair.

    Args:
        rig: cameras, and the surface that both look through.
        swell: whether there is room for waves that are too long to leave a miss.
    """

    def __init__(self, rig: StereoRig, swell: bool = True) -> None:
        self._may_swell = swell
        surface = rig.interface
        assert surface is not None
        centre = -rig.rotation.T @ rig.translation
        baseline = float(np.linalg.norm(centre))
        along = centre / baseline
        normal = surface.normal
        # A miss is across the baseline as the right camera sees it: this gives it its sign.
        x, y, _ = rig.translation.tolist()
        self._sign = (-y, x)
        self._middle = 0.5 * centre
        self._normal = normal
        self._along_normal = np.outer(normal, normal)
        self._across_normal = np.eye(3) - self._along_normal
        self._distance = surface.distance
        self._height = surface.distance - float(normal @ self._middle)
        self._index = surface.target_index / surface.indices[0]
        self._apart = baseline * math.sqrt(max(1.0 - float(normal @ along) ** 2, 0.0))
        self.reset()

    def reset(self) -> None:
        """Forget all pairs: the water is taken for calm."""
        self._stamp: float | None = None
        self._total = self._mean = self._absolute = 0.0
        self._count = self._square = 0.0
        self._compared = self._product = self._lag = 0.0
        self._delay = _Delay(_MISS_LAG)
        self._heights = _Heights()

    @property
    def level(self) -> float:
        """The waves' deviation in the rays' miss, in pixel noises; 0 where it may be chance."""
        added = self._deviation**2 - 1.0
        # Of n Gaussian misses of deviation 1, the square of the deviation by their mean absolute
        # value scatters by the root of (2 pi - 4) / n; a fading sum is as good as n of them.
        pairs = max(2.0 * self._total - 1.0, 1.0)
        chance = _SURE * math.sqrt((2.0 * math.pi - 4.0) / pairs)
        return math.sqrt(added) if added > chance else 0.0

    @property
    def frequency(self) -> float:
        """The waves' mean frequency in the rays' miss (Hz); nan where it does not show."""
        swing = self._square - 1.0
        if swing < _SURE * math.sqrt(2.0 / max(self._count, 1.0)) or self._compared < _LEAST_PAIRS:
            return math.nan
        likeness = min(max(self._product / swing, -1.0), 1.0)
        return max(math.acos(likeness) / (2.0 * math.pi * self._lag), _SLOWEST)

    @property
    def _surely_short(self) -> bool:
        """Whether misses are less alike than those of long waves, beyond chance."""
        if self._compared < _LEAST_PAIRS:
            return False
        least = (self._square - 1.0) * math.cos(2.0 * math.pi * _LONG_WAVES * self._lag)
        return self._product < least - _SURE * self._square / math.sqrt(self._compared)

    @property
    def _deviation(self) -> float:
        return _MEAN_ABSOLUTE_TO_DEVIATION * self._absolute

    def add(
        self, stamp: float, residuals: Array, covs: tuple[Array, Array], point: Array, noise: Array
    ) -> Fluctuation:
        """Take one pair in, and return what the medium adds to the covariance of its position.

        Args:
            stamp: of the pair, s; one that jumps back begins anew.
            residuals: (4,) px, observed minus predicted, left u, v then right u, v.
            covs: (2, 2) of the left and of the right pixel, px^2.
            point: (3,) the position, m.
            noise: (3, 3) its covariance by pixel noise, m^2.
        """
        self._follow(stamp, self._signed_miss(residuals, covs))
        frequency = self.frequency
        level, height = self.level, float(self._normal.dot(point))
        depth = max(height - self._distance, 0.0)
        shifted = level * level * noise if level > 0.0 else _NOTHING
        # Long waves swing too slowly to count as noise.
        short = _NOTHING if frequency < _LONG_WAVES else shifted
        long = self._long(frequency, depth, point, noise)
        if math.isnan(frequency) and self._lag * _LONG_WAVES * _FEWEST_FRAMES > 1.0:
            # Frames as rare never tell that waves are short: what is not told is not averaged.
            short, long = _NOTHING, shifted
        if self._may_swell and not (level > 0.0 and self._surely_short):
            along_normal = float(self._normal.dot(noise).dot(self._normal))
            long = long + self._raised(depth, *self._heights.add(stamp, height, along_normal))
        return Fluctuation(short, long)

    def _signed_miss(self, residuals: Array, covs: tuple[Array, Array]) -> float:
        """Return the rays' miss in deviations of pixel noise."""
        lu, lv, ru, rv = residuals.tolist()
        total = 0.0
        for u, v, cov in ((lu, lv, covs[0]), (ru, rv, covs[1])):
            (a, b), (_, c) = cov.tolist()
            total += (c * u * u - 2.0 * b * u * v + a * v * v) / (a * c - b * b)
        x, y = self._sign
        return math.copysign(math.sqrt(max(total, 0.0)), ru * x + rv * y)

    def _follow(self, stamp: float, miss: float) -> None:
        elapsed = 0.0 if self._stamp is None else stamp - self._stamp
        if elapsed < 0.0:
            self.reset()
            elapsed = 0.0
        self._stamp = stamp
        fading = math.exp(-elapsed / _LEVEL_MEMORY)
        usual = max(self._deviation, 1.0)
        self._total = self._total * fading + 1.0
        gain = 1.0 / self._total
        apart = miss - self._mean
        apart = min(max(apart, -_FARTHEST * usual), _FARTHEST * usual)
        self._count = self._count * math.exp(-elapsed / _COLOUR_MEMORY) + 1.0
        self._mean += apart / (self._count + _DOUBTED)
        self._absolute += gain * (abs(apart) - self._absolute)
        self._square += (apart * apart - self._square) / self._count
        compared = self._delay.older(stamp, apart)
        if compared is not None:
            lag, older = compared
            self._compared = self._compared * math.exp(-elapsed / _COLOUR_MEMORY) + 1.0
            self._product += (apart * older - self._product) / self._compared
            self._lag += (lag - self._lag) / self._compared

    def _raised(self, depth: float, variance: float, frequency: float) -> Array:
        """Return what a surface may have done that goes up and down as the target seems to.

        Args:
            depth: of the target below the surface, m.
            variance: of its slow part, m^2.
            frequency: of that, Hz.
        """
        if variance <= 0.0:
            return _NOTHING
        hidden = 1.0 - 1.0 / self._index
        slope = (2.0 * math.pi * frequency) ** 2 / GRAVITY / (self._index - 1.0)
        across = variance * (depth * hidden * slope) ** 2
        return variance * self._along_normal + across * self._across_normal

    def _long(self, frequency: float, depth: float, point: Array, noise: Array) -> Array:
        """Return what long waves add: see the head of this file."""
        if not frequency < _LONG_WAVES:
            return _NOTHING
        below = depth / self._index
        separation = self._apart * below / (self._height + below)
        wavenumber = (2.0 * math.pi * frequency) ** 2 / GRAVITY
        across, along = _LIKENESS.dot(np.cos(wavenumber * separation * _COSINES)).tolist()
        if across >= 1.0:
            return _NOTHING
        # In units of what independent shifts of the same miss would do.
        common = math.sqrt((1.0 + across) / (1.0 - across))
        further = math.sqrt((1.0 - along) / (1.0 - across)) - common
        # Again few periods tell little.
        doubt = 1.0 + 2.0 / (frequency * _COLOUR_MEMORY)
        scale = doubt * (self._square - 1.0)
        # The noise, stretched by `common` in all directions and `further` along the line of sight.
        sight = point - self._middle
        sight /= math.sqrt(float(sight.dot(sight)))
        leaning = noise.dot(sight)
        along_sight = float(sight.dot(leaning))
        leaning *= scale * further * common
        leaning += (0.5 * scale * further * further * along_sight) * sight
        both = np.multiply.outer(sight, leaning)
        result: Array = (scale * common * common) * noise
        result += both
        result += both.T
        if depth > 0.0:
            (xx, _, _), (_, yy, _), (_, _, zz) = noise.tolist()
            lateral = 0.5 * scale * common * common * (xx + yy + zz - along_sight)
            # A slope s shifts the target by depth s (1 - 1/n); a crest of s / k raises the
            # surface, and hides (n - 1) of its height.
            crest = math.sqrt(lateral) / (depth * (1.0 - 1.0 / self._index) * wavenumber)
            rise = (self._index - 1.0) * crest
            result += rise * rise * self._along_normal
        return result
