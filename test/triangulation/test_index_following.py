"""The live index over time: drift, jumps, outliers, noise that is not as stated."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.triangulation.following import OUTLIER
from binopos_ros.triangulation.index import IndexEstimator
from index_settings import COVARIANCE, PIXEL_STD, SETTINGS, correlated, images, path, run


def test_gross_outliers_neither_move_it_nor_make_it_sure():
    setting, random = SETTINGS['one camera above the other'], np.random.default_rng(10)
    squares, reasons = [], []
    for _ in range(40):
        truth = random.normal(1.355, 0.015)
        pixels = images(setting.rig.with_target_index(truth), path(setting, 60, random))
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        wrong = random.uniform(size=60) < 0.1
        pixels[wrong, 2:] += random.uniform(-20, 20, (wrong.sum(), 2))
        states = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)
        squares.append(((states[-1].mean - truth) / states[-1].std) ** 2)
        reasons += [state.reason for state, bad in zip(states, wrong, strict=True) if bad]
    assert np.mean(squares) < 1.6
    assert np.mean([reason == OUTLIER for reason in reasons]) > 0.9


def test_it_follows_salt_that_dissolves_and_a_constant_index_does_not():
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(11)
    stamps = np.arange(900) / 10.0
    truth = 1.335 + 0.02 * stamps / stamps[-1]
    points = path(setting, len(stamps), random)
    pixels = np.array(
        [
            images(setting.rig.with_target_index(index), point)
            for index, point in zip(truth, points, strict=True)
        ]
    )
    pixels += PIXEL_STD * random.standard_normal(pixels.shape)
    following = run(IndexEstimator(1.335, 0.015, drift=1e-3), setting.rig, pixels, rate=10.0)
    constant = run(IndexEstimator(1.335, 0.015), setting.rig, pixels, rate=10.0)
    late = slice(300, None)
    scores = [
        (state.mean - index) / state.std
        for state, index in zip(following[late], truth[late], strict=True)
    ]
    assert np.sqrt(np.mean(np.square(scores))) < 1.5
    assert all(state.observed for state in following[late])
    lags = [
        np.sqrt(
            np.mean([(s.mean - n) ** 2 for s, n in zip(states[late], truth[late], strict=True)])
        )
        for states in (following, constant)
    ]
    assert lags[1] > 2 * lags[0]


def test_without_data_it_returns_to_the_prior_and_is_never_less_sure_than_it():
    setting, random = SETTINGS['tank wall'], np.random.default_rng(12)
    estimator = IndexEstimator(1.34, 0.015, drift=1e-3)
    pixels = images(setting.rig, path(setting, 30, random))
    assert run(estimator, setting.rig, pixels)[-1].observed
    lost = [np.nan, np.nan]
    stds = []
    for elapsed in (1, 60, 600, 1e5):
        state = estimator.update(setting.rig, lost, lost, stamp=1.0 + elapsed)
        stds.append(state.std)
    assert stds == sorted(stds)
    assert stds[-1] == pytest.approx(0.015)
    assert state.mean == pytest.approx(1.34)
    assert not state.observed


def test_a_stamp_that_jumps_back_forgets_nothing():
    setting, random = SETTINGS['tank wall'], np.random.default_rng(13)
    pixels = images(setting.rig, path(setting, 30, random))
    estimator = IndexEstimator(1.34, 0.015, drift=1e-3)
    before = run(estimator, setting.rig, pixels, start=1e6)[-1]
    after = run(estimator, setting.rig, pixels[:1], start=0.0)[-1]
    assert after.std <= before.std


def test_an_index_that_jumps_is_found_again():
    setting, random = SETTINGS['oblique along the baseline'], np.random.default_rng(14)
    points = path(setting, 300, random)
    noise = PIXEL_STD * random.standard_normal((300, 4))
    estimator = IndexEstimator(1.36, 0.015)
    run(estimator, setting.rig, images(setting.rig.with_target_index(1.333), points) + noise)
    brine = images(setting.rig.with_target_index(1.38), points) + noise
    states = run(estimator, setting.rig, brine)
    assert states[-1].mean == pytest.approx(1.38, abs=4 * states[-1].std)


@pytest.mark.parametrize(
    ('correlation', 'std'),
    [(0.9, PIXEL_STD), (0.0, 3 * PIXEL_STD), (0.9, 3 * PIXEL_STD), (0.9, 20 * PIXEL_STD)],
)
def test_noise_that_is_not_as_stated_does_not_make_it_overconfident(correlation, std):
    """Waves disturb neighbouring pairs alike; detectors understate their noise."""
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(15)
    squares = []
    for _ in range(12):
        truth = random.normal(1.355, 0.015)
        pixels = images(setting.rig.with_target_index(truth), path(setting, 250, random))
        pixels += correlated(random, 250, correlation, std)
        state = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)[-1]
        squares.append(((state.mean - truth) / state.std) ** 2)
    assert np.mean(squares) < 2.5


@pytest.mark.parametrize('prior_mean', [1.02, 1.33, 2.5])
def test_with_a_wide_prior_the_index_stays_possible_and_is_found(prior_mean):
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(21)
    pixels = images(setting.rig, path(setting, 60, random))
    pixels += PIXEL_STD * random.standard_normal(pixels.shape)
    states = run(IndexEstimator(prior_mean, 0.5), setting.rig, pixels)
    assert all(1.0 <= state.mean <= 4.0 for state in states)
    assert states[-1].mean == pytest.approx(1.355, abs=4 * states[-1].std)
    assert states[-1].std < 0.005


@pytest.mark.parametrize(
    ('left', 'covariance', 'reason'),
    [
        ([np.nan, 480.0], COVARIANCE, 'finite'),
        ([600.0, 480.0], [[1.0, 2.0], [2.0, 1.0]], 'left covariance is not positive definite'),
        ([100.0, 480.0], COVARIANCE, ''),
    ],
)
def test_a_pair_without_a_point_leaves_the_index_alone_and_has_a_reason(left, covariance, reason):
    rig = SETTINGS['washbowl, corner'].rig
    state = IndexEstimator(1.34, 0.015).update(rig, left, [500.0, 480.0], covariance, COVARIANCE)
    assert reason in state.reason
    assert state.reason
    assert (state.mean, state.std, state.observed) == (1.34, 0.015, False)
    assert np.isnan(state.point).all()
    assert np.isnan(state.covariance).all()
