"""The medium's fluctuation by the rays' miss, on light traced through moving surfaces."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.evaluation.trials.basin import Basin
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.simulation.waves import WaveSpectrum
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.medium import MediumMeter, may_wave

PIXEL = 0.05
NOISE = PIXEL**2 * np.eye(2)
BASIN = Basin(surface=0.78, focal_length=1010.0)


def rig():
    camera = PinholeCamera(np.diag([1010.0, 1010.0, 1.0]), np.zeros(4), (1280, 960))
    water = FlatInterface([0, 0, 1], BASIN.surface, [1.0, BASIN.index])
    return StereoRig(camera, camera, np.eye(3), [-BASIN.baseline, 0, 0], water)


def seen_through(
    band, slope, seed, target=(0.1, 0.03, 1.1), speed=(0.0, 0.0, 0.0), count=300, swell=True
):
    """Return truth, points, their covariances, the medium's parts and the meter."""
    random = np.random.default_rng(seed)
    stamps = np.arange(count) / 30.0
    truth = np.array(target) + np.outer(stamps, speed)
    lowest, highest, peak = band
    shape = {'peak': peak, 'lowest': lowest, 'highest': highest, 'depth': 0.6}
    steep = WaveSpectrum(1e-3, **shape).realise(np.random.default_rng(seed)).rms_slope
    spectrum = WaveSpectrum(1e-3 * slope / steep if slope else 0.0, **shape)
    waves = spectrum.realise(random)
    left, right = BASIN.pixels(truth, stamps, waves, np.ones(count))
    left += random.normal(0.0, PIXEL, left.shape)
    right += random.normal(0.0, PIXEL, right.shape)
    found = triangulate(rig(), left, right, NOISE, NOISE)
    meter = MediumMeter(rig(), swell)
    parts = [
        meter.add(float(t), miss, (NOISE, NOISE), point, covariance)
        for t, miss, point, covariance in zip(
            stamps, found.residuals, found.points, found.covariances, strict=True
        )
    ]
    return truth, found.points, found.covariances, parts, meter


def normalised(error, covariances):
    return np.einsum('ni,nij,nj->n', error, np.linalg.inv(covariances), error) / 3.0


def test_basin_waves_make_the_stated_covariance_true_to_a_factor_of_two():
    squares = []
    for seed in range(4):
        truth, points, noise, parts, meter = seen_through((1.6, 6.0, 2.5), 0.02, seed)
        whole = noise + [part.short + part.long for part in parts]
        squares.append(normalised(points - truth, whole)[30:])
        assert meter.level > 3.0
    assert 0.5 < np.mean(squares) < 2.5
    # Without the medium's part it is off by orders of magnitude.
    assert np.mean(normalised(points - truth, noise)[30:]) > 50.0


def test_chop_is_told_by_its_frequency_and_its_covariance_covers_it():
    inside = []
    for seed in range(4):
        truth, points, noise, parts, meter = seen_through((0.8, 1.2, 1.0), 0.02, seed)
        assert meter.frequency < 2.0
        whole = noise + [part.short + part.long for part in parts]
        inside.append(3.0 * normalised(points - truth, whole)[90:] < 7.815)
    assert np.mean(inside) > 0.75


@pytest.mark.parametrize('speed', [(0.0, 0.0, 0.0), (0.1, 0.04, 0.02)])
def test_calm_water_adds_next_to_nothing_however_the_target_moves(speed):
    start = (-0.1, -0.05, 1.05)
    for seed in range(3):
        _, _, noise, parts, _ = seen_through(
            (1.6, 6.0, 2.5), 0.0, seed, start, speed, count=120, swell=False
        )
        added = np.array([part.short + part.long for part in parts])[90:]
        ratio = np.trace(added, axis1=1, axis2=2) / np.trace(noise[90:], axis1=1, axis2=2)
        assert np.median(ratio) < 0.5


def test_a_target_that_goes_up_where_there_may_be_swell_is_stated_with_both_readings():
    rising = (0.0, 0.0, 0.02)
    _, points, noise, parts, _ = seen_through((1.6, 6.0, 2.5), 0.0, 1, speed=rising, count=150)
    added = parts[-1].long
    assert np.abs(parts[-1].short).max() < 0.5 * noise[-1, 2, 2]
    assert added[2, 2] > np.var(points[:, 2])
    # Sideways only as far as a slope takes it that goes with such a rise.
    assert added[0, 0] < 0.01 * added[2, 2]


def test_what_swell_does_is_not_forgotten_where_the_target_was_out_of_sight():
    _, points, noise, parts, meter = seen_through((0.15, 0.5, 0.3), 0.02, 1)
    before = parts[-1].long[2, 2]
    assert before > 10.0 * noise[-1, 2, 2]
    for frame in range(6):
        stamp = 11.0 + frame / 30.0
        after = meter.add(stamp, np.zeros(4), (NOISE, NOISE), points[-1], noise[-1])
        assert after.long[2, 2] > 0.3 * before


def test_one_wrong_pair_is_no_wave():
    _, points, noise, _, meter = seen_through((1.6, 6.0, 2.5), 0.0, 5, count=150)
    before = meter.level
    wrong = np.array([0.0, -2.0, 0.0, 2.0])
    meter.add(5.0, wrong, (NOISE, NOISE), points[-1], noise[-1])
    assert meter.level < before + 1.0


def test_ports_and_panes_do_not_wave():
    pane = FlatInterface([0, 0, 1], 0.3, [1.0, 1.5, 1.333], [0.01])
    assert not may_wave(pane)
    assert not may_wave(None)
    assert may_wave(FlatInterface([0, 0, 1], 0.3, [1.0, 1.333]))
