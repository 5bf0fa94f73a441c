"""Waves against the textbooks' figures and against finite differences."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.simulation.errors import SimulationError
from binopos_ros.simulation.waves import (
    DENSITY,
    GRAVITY,
    SURFACE_TENSION,
    WaveSpectrum,
    angular_frequency,
    wavenumber,
    waves_of_peak,
)


def test_the_slowest_ripple_is_the_one_of_lamb() -> None:
    """Lamb (1932, art. 267): 23.2 cm/s at 1.73 cm (his surface tension was 74 dyn/cm)."""
    wavelength = np.linspace(0.005, 0.05, 20001)
    k = 2 * np.pi / wavelength
    speed = angular_frequency(k) / k
    slowest = np.argmin(speed)
    assert speed[slowest] == pytest.approx(0.232, rel=0.01)
    assert wavelength[slowest] == pytest.approx(0.0173, rel=0.02)
    # The closed form of the minimum.
    assert speed[slowest] == pytest.approx((4 * GRAVITY * SURFACE_TENSION / DENSITY) ** 0.25)


def test_an_ocean_swell_of_ten_seconds_is_156_metres_long() -> None:
    """The deep-water rule L = 1.56 T^2 of the coastal manuals."""
    assert 2 * np.pi / wavenumber(0.1) == pytest.approx(156.1, rel=1e-3)


@pytest.mark.parametrize(
    ('depth_over_deep_length', 'depth_over_length'),
    [(0.01, 0.04032), (0.05, 0.09416), (0.1, 0.1410), (0.2, 0.2251), (0.5, 0.5018)],
)
def test_finite_depth_follows_wiegels_table(
    depth_over_deep_length: float, depth_over_length: float
) -> None:
    """Wiegel (1954), Gravity waves: tables of functions, d/L for d/L0."""
    depth = 10.0
    deep_length = depth / depth_over_deep_length
    frequency = np.sqrt(GRAVITY / (2 * np.pi * deep_length))
    length = 2 * np.pi / wavenumber(frequency, depth)
    assert depth / length == pytest.approx(depth_over_length, rel=2e-3)


def test_long_waves_in_shallow_water_run_at_the_root_of_g_h() -> None:
    k = 2 * np.pi / 100.0
    assert angular_frequency(k, 0.5) / k == pytest.approx(np.sqrt(GRAVITY * 0.5), rel=1e-3)


@pytest.mark.parametrize('depth', [0.02, 0.49, np.inf])
def test_wavenumber_inverts_the_dispersion_relation(depth: float) -> None:
    frequency = np.geomspace(0.1, 50, 200)
    back = angular_frequency(wavenumber(frequency, depth), depth) / (2 * np.pi)
    np.testing.assert_allclose(back, frequency, rtol=1e-12)


def test_slopes_are_the_derivatives_of_the_height() -> None:
    field = WaveSpectrum(0.001, depth=0.49).realise(np.random.default_rng(1))
    rng = np.random.default_rng(2)
    x, y, t = rng.uniform(-1, 1, (3, 50))
    step = 1e-6
    _, slope_x, slope_y = field.height_and_slope(x, y, t)
    ahead, behind = (field.height_and_slope(x + d, y, t)[0] for d in (step, -step))
    np.testing.assert_allclose(slope_x, (ahead - behind) / (2 * step), atol=1e-8)
    ahead, behind = (field.height_and_slope(x, y + d, t)[0] for d in (step, -step))
    np.testing.assert_allclose(slope_y, (ahead - behind) / (2 * step), atol=1e-8)


def test_a_long_record_has_the_stated_height_slope_and_spectrum() -> None:
    spectrum = WaveSpectrum(0.002, peak=2.5, depth=0.49, components=64)
    field = spectrum.realise(np.random.default_rng(3))
    rate, seconds = 40.0, 400.0
    times = np.arange(0, seconds, 1 / rate)
    height, slope_x, slope_y = field.height_and_slope(np.zeros(1), np.zeros(1), times)
    assert height.std() == pytest.approx(0.002, rel=0.05)
    assert np.hypot(slope_x, slope_y).std(axis=None) > 0
    assert np.sqrt(np.mean(slope_x**2 + slope_y**2)) == pytest.approx(field.rms_slope, rel=0.05)
    power = np.abs(np.fft.rfft(height)) ** 2
    frequency = np.fft.rfftfreq(len(times), 1 / rate)
    shares = [
        power[(frequency >= low) & (frequency < high)].sum() / power.sum()
        for low, high in ((1.55, 2.5), (2.5, 3.5), (3.5, 6.1))
    ]
    grid = np.linspace(1.6, 6, 20001)
    density = spectrum.density(grid)
    expected = [
        density[(grid >= low) & (grid < high)].sum() / density.sum()
        for low, high in ((1.55, 2.5), (2.5, 3.5), (3.5, 6.1))
    ]
    np.testing.assert_allclose(shares, expected, atol=0.05)


def test_each_wave_runs_at_its_own_phase_speed() -> None:
    field = WaveSpectrum(0.001, depth=0.49, components=1).realise(np.random.default_rng(5))
    k = np.linalg.norm(field.wavevectors[0])
    speed = field.angular_frequencies[0] / k
    assert speed == pytest.approx(float(angular_frequency(k, 0.49) / k))
    heading = field.wavevectors[0] / k
    seconds = 0.3
    here = field.height_and_slope(np.array([0.1]), np.array([0.2]), 0.0)[0]
    x, y = np.array([0.1, 0.2]) + heading * speed * seconds
    there = field.height_and_slope(np.array([x]), np.array([y]), seconds)[0]
    np.testing.assert_allclose(there, here, atol=1e-15)


@pytest.mark.parametrize(
    'bad',
    [
        {'rms_height': -1e-3},
        {'rms_height': float('nan')},
        {'rms_height': 1e-3, 'lowest': 5.0, 'highest': 2.0},
        {'rms_height': 1e-3, 'depth': 0.0},
        {'rms_height': 1e-3, 'components': 0},
    ],
)
def test_impossible_waves_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(SimulationError, match='give'):
        WaveSpectrum(**bad)  # type: ignore[arg-type]


@pytest.mark.parametrize('peak', [0.1, 0.3, 1.0, 2.5, 6.0])
def test_waves_from_swell_to_ripples_have_their_energy_about_the_peak(peak):
    spectrum = waves_of_peak(1e-3, peak, 0.6)
    field = spectrum.realise(np.random.default_rng(1))
    frequencies = field.angular_frequencies / (2 * np.pi)
    assert field.rms_height == pytest.approx(1e-3)
    assert 0.6 * peak < np.median(frequencies) < 2.0 * peak


@pytest.mark.parametrize('peak', [0.05, 7.0])
def test_waves_that_no_water_has_are_refused_by_name(peak):
    with pytest.raises(SimulationError, match='swell'):
        waves_of_peak(1e-3, peak, 0.6)
