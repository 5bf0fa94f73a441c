"""The refractive index of water from its temperature, salinity, depth and the light's wavelength.

Millard and Seaver, "An index of refraction algorithm for seawater over temperature, pressure,
salinity, density, and wavelength", Deep-Sea Research 37 (1990) 1909-1926: a polynomial of 27
terms in four groups (fresh water at the surface, salt, pressure, salt under pressure). The index
is relative to air, as an interface with a camera side of 1.0 wants it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from binopos_ros.triangulation.errors import TriangulationError

# Standard gravity, m/s^2, and Pa per decibar.
_GRAVITY = 9.80665
_DECIBAR = 1e4
# Absolute salinity (g/kg) of standard sea water of practical salinity 35 (TEOS-10).
_ABSOLUTE_PER_PRACTICAL = 35.16504 / 35.0
# Contraction of water by dissolved sea salt: kg/m^3 per g/kg, near the surface.
_DENSITY_PER_SALINITY = 0.77

# The publication's standard deviations: fresh water at the surface, salt, pressure.
_STD_FRESH, _STD_SALT, _STD_PRESSURE = 0.12e-6, 4.7e-6, 26.5e-6

VALID_RANGES = {
    'temperature': (0.0, 30.0, 'deg C'),
    'salinity': (0.0, 43.0, 'g/kg'),
    'wavelength_nm': (500.0, 700.0, 'nm'),
    'pressure': (0.0, 11000.0, 'dbar'),
}


@dataclass(frozen=True)
class IndexPrior:
    """What is known of the refractive index before the first image: mean and standard deviation.

    The index is relative to the medium whose index is 1 in the interface (air).
    """

    mean: float
    std: float


def pressure_at_depth(depth: float, salinity: float) -> float:
    """Return the gauge pressure (dbar) at `depth` (m) of water with `salinity` (g/kg).

    Hydrostatic with the density at the surface; 1 % low at 4 km, which is 6e-5 of index.
    """
    return (1000.0 + _DENSITY_PER_SALINITY * salinity) * _GRAVITY * depth / _DECIBAR


def water_index(
    temperature: float, salinity: float, wavelength_nm: float, depth: float = 0.0
) -> float:
    """Return the refractive index of water relative to air.

    Args:
        temperature: deg C, 0 to 30.
        salinity: absolute salinity, g/kg, 0 to 43. Brine is saltier than the formula reaches:
            give its index directly.
        wavelength_nm: wavelength of the light in air, nm, 500 to 700. A red target seen through
            a colour camera's red filter: 600 to 650.
        depth: m below the surface (gauge pressure up to 11,000 dbar).

    Raises:
        TriangulationError: an input outside the formula's range; nothing is extrapolated.
    """
    pressure = pressure_at_depth(depth, salinity)
    _check_range('temperature', temperature)
    _check_range('salinity', salinity)
    _check_range('wavelength_nm', wavelength_nm)
    _check_range('pressure', pressure)
    t, p, s = temperature, pressure, salinity / _ABSOLUTE_PER_PRACTICAL
    micron = wavelength_nm * 1e-3
    w2 = micron * micron

    fresh = (
        1.3280657
        - 4.5536802e-3 * w2
        + (2.5471707e-3 + (7.501966e-6 + 2.802632e-6 / w2) / w2) / w2
        + t * (-5.2883907e-6 + t * (-3.0738272e-6 + t * (3.0124687e-8 - 2.0883178e-10 * t)))
        + micron * t * (1.0508621e-5 + t * (2.1282248e-7 - 1.705881e-9 * t))
    )
    salt = s * (
        1.9029121e-4
        + 2.4239607e-6 / w2
        + t * (-7.3960297e-7 + t * (8.9818478e-9 + 1.2078804e-10 * t))
        - 3.589495e-7 * micron * t
    )
    pressed = p * (
        1.5868383e-6
        - 1.574074e-11 * p
        + 1.0712063e-8 / w2
        + t * (-9.4834486e-9 + t * (1.0100326e-10 + 5.8085198e-15 * p))
    )
    salt_pressed = p * s * (-1.1177517e-9 + t * (5.7311268e-11 - 1.5460458e-12 * t))
    return fresh + salt + pressed + salt_pressed


def index_prior(
    temperature: float,
    salinity: float,
    wavelength_nm: float,
    depth: float = 0.0,
    *,
    temperature_std: float = 1.0,
    salinity_std: float = 0.5,
    wavelength_std_nm: float = 15.0,
    depth_std: float = 0.0,
) -> IndexPrior:
    """Return the prior of the index that rests on measured or guessed conditions.

    The standard deviation adds, in squares, what each input's standard deviation does to the
    index (the larger of one step up and one step down, kept inside the formula's range) and the
    formula's own. Units as in `water_index`; each `*_std` is in the unit of its input.

    Raises:
        TriangulationError: an input outside the formula's range, or a negative deviation.
    """
    at = {
        'temperature': temperature,
        'salinity': salinity,
        'wavelength_nm': wavelength_nm,
        'depth': depth,
    }
    stds = {
        'temperature': temperature_std,
        'salinity': salinity_std,
        'wavelength_nm': wavelength_std_nm,
        'depth': depth_std,
    }
    mean = water_index(**at)
    variance = _STD_FRESH**2
    if salinity > 0:
        variance += _STD_SALT**2
    if depth > 0:
        variance += _STD_PRESSURE**2
    for name, std in stds.items():
        if not (math.isfinite(std) and std >= 0):
            msg = f'standard deviation of {name} is {std}: give a finite number, 0 or more'
            raise TriangulationError(msg)
        low, high, _ = VALID_RANGES.get(name, (0.0, math.inf, ''))
        steps = [max(at[name] - std, low), min(at[name] + std, high)]
        variance += max((water_index(**{**at, name: step}) - mean) ** 2 for step in steps)
    return IndexPrior(mean, math.sqrt(variance))


def _check_range(name: str, value: float) -> None:
    low, high, unit = VALID_RANGES[name]
    if not low <= value <= high:
        msg = (
            f'water index: {name} is {value:g} {unit}, outside the formula ({low:g} to {high:g} '
            f"{unit}; Millard and Seaver 1990): give the medium's index and its deviation directly"
        )
        raise TriangulationError(msg)
