"""Waves on a water surface: gravity and surface tension, finite depth, a random sea of them.

A small wave of wavenumber k (rad/m) on water of depth h runs at the angular frequency (rad/s)

    omega^2 = (g k + sigma / rho k^3) tanh(k h)

(Lamb, Hydrodynamics, 6th ed., 1932, art. 267; Lighthill, Waves in Fluids, 1978, sec. 3.1-3.3).
Linear theory: the waves add up, which holds while the slope stays well under 1.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from binopos_ros.simulation.errors import SimulationError

Array = NDArray[np.float64]

#: Standard acceleration of gravity, m/s^2.
GRAVITY = 9.80665
#: Surface tension of clean water against air at 20 C, N/m (IAPWS R1-76(2014)).
SURFACE_TENSION = 0.07275
#: Density of water at 20 C, kg/m^3.
DENSITY = 998.2


def angular_frequency(wavenumber: ArrayLike, depth: float = np.inf) -> Array:
    """Angular frequency (rad/s) of waves of a wavenumber (rad/m) on water of `depth` (m)."""
    k = np.asarray(wavenumber, float)
    tanh = np.ones_like(k) if np.isinf(depth) else np.tanh(k * depth)
    return np.sqrt((GRAVITY * k + SURFACE_TENSION / DENSITY * k**3) * tanh)


def wavenumber(frequency: ArrayLike, depth: float = np.inf) -> Array:
    """Wavenumber (rad/m) of waves of the given frequency (Hz): the dispersion relation inverted.

    omega(k) rises monotonically, so bisection to rounding is safe; tanh(kh) >= 0.76 min(1, kh)
    gives the upper end of the bracket.
    """
    omega = 2 * np.pi * np.asarray(frequency, float)
    highest = np.maximum(
        omega**2 / (0.76 * GRAVITY), omega / np.sqrt(0.76 * GRAVITY * min(depth, 1e6))
    )
    lowest = np.zeros_like(highest)
    for _ in range(60):
        middle = 0.5 * (lowest + highest)
        above = angular_frequency(middle, depth) > omega
        highest = np.where(above, middle, highest)
        lowest = np.where(above, lowest, middle)
    return 0.5 * (lowest + highest)


@dataclasses.dataclass(frozen=True)
class WaveSpectrum:
    """A random wavy surface by its statistics.

    The energy over frequency has the one-peaked shape f^-5 exp(-1.25 (peak / f)^4) of Pierson
    and Moskowitz (J. Geophys. Res. 69, 1964), cut to lowest .. highest; directions are spread over
    the full circle, as walls throw the waves back.

    Attributes:
        rms_height: standard deviation of the surface's height, m.
        peak: frequency of the highest waves, Hz.
        lowest, highest: band, Hz; 1.6 to 6 Hz is what small basins show.
        depth: depth of the water, m.
        components: number of plane waves that make up the surface.
    """

    rms_height: float
    peak: float = 2.5
    lowest: float = 1.6
    highest: float = 6.0
    depth: float = np.inf
    components: int = 32

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rms_height) and self.rms_height >= 0):
            msg = f'wave height is {self.rms_height!r} m: give a finite value of 0 or more'
            raise SimulationError(msg)
        in_order = 0 < self.lowest <= self.peak <= self.highest and self.lowest < self.highest
        if not (in_order and self.depth > 0):
            msg = (
                f'waves of {self.lowest} to {self.highest} Hz with the peak at {self.peak} Hz on '
                f'{self.depth} m of water do not exist: give a peak within the band, and a depth '
                'above 0'
            )
            raise SimulationError(msg)
        if self.components < 1:
            msg = f'a surface of {self.components} waves: give at least 1'
            raise SimulationError(msg)

    def density(self, frequency: ArrayLike) -> Array:
        """Relative energy per hertz at the given frequencies (Hz); zero outside the band."""
        f = np.asarray(frequency, float)
        inside = (f >= self.lowest) & (f <= self.highest)
        safe = np.where(inside, f, self.peak)
        return np.where(inside, safe**-5 * np.exp(-1.25 * (self.peak / safe) ** 4), 0.0)

    def realise(self, rng: np.random.Generator) -> WaveField:
        """Draw one surface: waves of equal energy, each somewhere in its share of the spectrum."""
        grid = np.linspace(self.lowest, self.highest, 2001)
        energy = np.concatenate([[0.0], np.cumsum(self.density(grid[1:] - np.diff(grid) / 2))])
        count = self.components
        quantiles = (np.arange(count) + rng.random(count)) / count
        frequency = np.interp(quantiles, energy / energy[-1], grid)
        k = wavenumber(frequency, self.depth)
        # Directions are dealt out evenly and shuffled, so that no draw sends all waves one way.
        heading = 2 * np.pi * (rng.permutation(count) + rng.random(count)) / count
        return WaveField(
            amplitudes=np.full(count, self.rms_height * np.sqrt(2 / count)),
            wavevectors=k[:, None] * np.column_stack([np.cos(heading), np.sin(heading)]),
            angular_frequencies=2 * np.pi * frequency,
            phases=2 * np.pi * rng.random(count),
        )


def waves_of_peak(rms_height: float, peak: float, depth: float) -> WaveSpectrum:
    """Return a spectrum about the frequency of its highest waves, Hz: 0.1 (swell) to 6 Hz.

    From 1.6 Hz on it has the band of small basins; slower waves have a band of the same
    proportions about their peak.

    Raises:
        SimulationError: a peak outside, or a height or depth that cannot be.
    """
    slowest, basin = 0.1, WaveSpectrum(0.0)
    if not slowest <= peak <= basin.highest:
        msg = f'waves with the peak at {peak!r} Hz: give {slowest} (swell) to {basin.highest:g} Hz'
        raise SimulationError(msg)
    if peak >= basin.lowest:
        return WaveSpectrum(rms_height, peak=peak, depth=depth)
    lowest, highest = (peak * edge / basin.peak for edge in (basin.lowest, basin.highest))
    return WaveSpectrum(rms_height, peak, lowest, highest, depth)


@dataclasses.dataclass(frozen=True)
class WaveField:
    """A surface that is a sum of plane waves: height(x, t) = sum of a cos(k.x - omega t + phase).

    Attributes:
        amplitudes: (M,) m.
        wavevectors: (M, 2) rad/m.
        angular_frequencies: (M,) rad/s.
        phases: (M,) rad.
        precision: in which sines are computed: single precision is 15 times as fast, and leaves
            errors of 4e-6 rad in the waves' phase.
    """

    amplitudes: Array
    wavevectors: Array
    angular_frequencies: Array
    phases: Array
    precision: type[np.floating[Any]] = np.float64

    @property
    def rms_height(self) -> float:
        """Standard deviation of the height, m."""
        return float(np.sqrt(np.sum(self.amplitudes**2) / 2))

    @property
    def rms_slope(self) -> float:
        """Standard deviation of the slope's length (both directions together)."""
        return float(np.sqrt(np.sum((self.amplitudes[:, None] * self.wavevectors) ** 2) / 2))

    def height_and_slope(self, x: Array, y: Array, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Height (m) and its derivatives along x and y at points of the plane (m) and times (s).

        `x`, `y` and `time` broadcast together.
        """
        time = np.asarray(time, float)
        shape = np.broadcast_shapes(x.shape, y.shape, time.shape)
        height, slope_x, slope_y = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        # Wave by wave: the sums stay in the cache, and their order is the same on any machine.
        for amplitude, (kx, ky), omega, phase in zip(
            self.amplitudes, self.wavevectors, self.angular_frequencies, self.phases, strict=True
        ):
            # Whole turns of the phase are taken off while all its digits are there.
            start = np.remainder(phase - omega * time, 2 * np.pi)
            argument = (kx * x + ky * y + start).astype(self.precision, copy=False)
            height += amplitude * np.cos(argument)
            rise = -amplitude * np.sin(argument)
            slope_x += kx * rise
            slope_y += ky * rise
        return height, slope_x, slope_y
