"""The water formula against its publication's table and against formulas it does not share."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.seawater import index_prior, pressure_at_depth, water_index

PRACTICAL = 35.16504 / 35.0  # g/kg per practical salinity unit

# Millard and Seaver 1990, Table 2, at 589.26 nm: (deg C, practical salinity, dbar, index).
TABLE_2 = [
    (0, 0, 0, 1.333949),
    (5, 0, 0, 1.333884),
    (10, 0, 0, 1.333691),
    (15, 0, 0, 1.333387),
    (20, 0, 0, 1.332988),
    (25, 0, 0, 1.332503),
    (5, 30, 0, 1.339666),
    (10, 30, 0, 1.339354),
    (15, 30, 0, 1.338950),
    (20, 30, 0, 1.338472),
    (25, 30, 0, 1.337933),
    (0, 35, 0, 1.340854),
    (5, 35, 0, 1.340630),
    (10, 35, 0, 1.340298),
    (15, 35, 0, 1.339878),
    (20, 35, 0, 1.339386),
    (25, 35, 0, 1.338838),
    (0, 40, 0, 1.341840),
    (25, 40, 0, 1.339743),
    (0, 0, 2000, 1.337122),
    (0, 0, 4000, 1.340168),
    (0, 0, 6000, 1.343089),
    (0, 0, 10000, 1.348552),
    (20, 0, 2000, 1.335871),
    (20, 0, 4000, 1.338647),
    (0, 35, 2000, 1.343948),
    (20, 35, 2000, 1.342228),
    (0, 35, 4000, 1.346916),
    (20, 35, 4000, 1.344962),
    (0, 35, 10000, 1.355065),
    (25, 35, 10000, 1.351836),
]


def depth_of(pressure, salinity):
    return pressure / pressure_at_depth(1.0, salinity)


@pytest.mark.parametrize(('temperature', 'practical', 'pressure', 'expected'), TABLE_2)
def test_reproduces_the_publications_table(temperature, practical, pressure, expected):
    salinity = practical * PRACTICAL
    index = water_index(temperature, salinity, 589.26, depth_of(pressure, salinity))
    assert index == pytest.approx(expected, abs=1.0e-6)


def index_iapws(celsius, wavelength_nm, density):
    """IAPWS R9-97 (1997), absolute index of pure water; density in kg/m^3."""
    rho, t, w2 = density / 1000.0, (celsius + 273.15) / 273.15, (wavelength_nm / 589.0) ** 2
    terms = (
        0.244257733
        + 9.74634476e-3 * rho
        - 3.73234996e-3 * t
        + 2.68678472e-4 * w2 * t
        + 1.58920570e-3 / w2
        + 2.45934259e-3 / (w2 - 0.2292020**2)
        + 0.900704920 / (w2 - 5.432937**2)
        - 1.66626219e-2 * rho**2
    )
    return math.sqrt((1 + 2 * rho * terms) / (1 - rho * terms))


def index_of_air(wavelength_nm):
    """Ciddor (1996), standard air at 15 deg C and 101,325 Pa."""
    k2 = (1e3 / wavelength_nm) ** 2
    return 1 + (5792105 / (238.0185 - k2) + 167917 / (57.362 - k2)) * 1e-8


@pytest.mark.parametrize(('celsius', 'density'), [(0, 999.84), (10, 999.70), (20, 998.21)])
@pytest.mark.parametrize('wavelength_nm', [500, 589.3, 620, 650, 700])
def test_agrees_with_iapws_for_fresh_water(celsius, density, wavelength_nm):
    expected = index_iapws(celsius, wavelength_nm, density) / index_of_air(wavelength_nm)
    assert water_index(celsius, 0.0, wavelength_nm) == pytest.approx(expected, abs=3e-5)


def index_quan_fry(celsius, practical, wavelength_nm):
    """Quan and Fry (1995), Applied Optics 34, 3477: a fit to other data, 400 to 700 nm."""
    w = wavelength_nm
    return (
        1.31405
        + (1.779e-4 - 1.05e-6 * celsius + 1.6e-8 * celsius**2) * practical
        - 2.02e-6 * celsius**2
        + (15.868 + 0.01155 * practical - 0.00423 * celsius) / w
        - 4382 / w**2
        + 1.1455e6 / w**3
    )


@given(st.floats(0, 30), st.floats(0, 35), st.floats(500, 700))
def test_agrees_with_quan_and_fry_at_the_surface(celsius, practical, wavelength_nm):
    expected = index_quan_fry(celsius, practical, wavelength_nm)
    index = water_index(celsius, practical * PRACTICAL, wavelength_nm)
    assert index == pytest.approx(expected, abs=1.5e-4)


@pytest.mark.parametrize(
    ('arguments', 'named'),
    [
        ((-1, 0, 620, 0), 'temperature'),
        ((31, 0, 620, 0), 'temperature'),
        ((20, 44, 620, 0), 'salinity'),
        ((20, 0, 450, 0), 'wavelength_nm'),
        ((20, 0, 620, -1), 'pressure'),
        ((20, 0, 620, 12000), 'pressure'),
        ((math.nan, 0, 620, 0), 'temperature'),
    ],
)
def test_refuses_to_extrapolate(arguments, named):
    with pytest.raises(TriangulationError, match=named) as caught:
        water_index(*arguments)
    assert '\n' not in str(caught.value)


def test_prior_adds_the_effects_of_its_inputs_in_squares():
    slopes = {
        'temperature_std': (index_iapws(21, 620, 997.99) - index_iapws(19, 620, 998.41)) / 2,
        'wavelength_std_nm': (index_quan_fry(20, 0, 621) - index_quan_fry(20, 0, 619)) / 2,
        'salinity_std': (index_quan_fry(20, 1, 620) - index_quan_fry(20, 0, 620)) / PRACTICAL,
    }
    stds = {'temperature_std': 3.0, 'wavelength_std_nm': 20.0, 'salinity_std': 2.0}
    expected = math.sqrt(sum((slopes[name] * stds[name]) ** 2 for name in stds))
    prior = index_prior(20, 0, 620, **stds)
    assert prior.mean == water_index(20, 0, 620)
    assert prior.std == pytest.approx(expected, rel=0.1)


def test_prior_is_never_surer_than_the_formula():
    exact = {'temperature_std': 0, 'salinity_std': 0, 'wavelength_std_nm': 0}
    assert index_prior(20, 0, 620, **exact).std >= 0.1e-6
    assert index_prior(20, 35, 620, 100, **exact).std > 26e-6


def test_prior_widens_at_the_edge_of_the_range_without_leaving_it():
    assert index_prior(29.9, 0, 690, temperature_std=5, wavelength_std_nm=50).std > 1e-4


@pytest.mark.parametrize('bad', [-1.0, math.nan, math.inf])
def test_prior_refuses_an_impossible_deviation(bad):
    with pytest.raises(TriangulationError, match='salinity'):
        index_prior(20, 0, 620, salinity_std=bad)
