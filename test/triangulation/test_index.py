"""The live index: consistent, efficient, and what one pair tells of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import optimize

from binopos_ros.optics import FlatInterface, OpticsError
from binopos_ros.optics.column import mean_index
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.evidence import gather_evidence
from binopos_ros.triangulation.index import IndexEstimator
from binopos_ros.triangulation.paper import frame_index
from every_rig import RIGS
from index_settings import (
    COVARIANCE,
    PIXEL_STD,
    SETTINGS,
    images,
    information,
    path,
    rig_through,
    run,
    trial,
)


@pytest.fixture(scope='module')
def trials():
    """Index errors and deviations of 1,000 runs over all settings, and each setting's bound."""
    random = np.random.default_rng(20)
    return [trial(name, 1000 // len(SETTINGS), 15, 0.015, random) for name in SETTINGS]


def test_the_error_is_as_large_as_it_says_over_a_thousand_runs(trials):
    squares = np.concatenate([(errors / stds) ** 2 for errors, stds, _ in trials])
    assert len(squares) == 1000
    assert squares.mean() == pytest.approx(1.0, abs=0.05)


def test_the_error_is_within_a_tenth_of_the_bound_in_every_setting(trials):
    for errors, stds, bound in trials:
        assert np.sqrt(np.mean(errors**2)) < 1.1 * bound
        assert stds.mean() == pytest.approx(bound, rel=0.1)


@pytest.mark.parametrize('name', SETTINGS)
def test_a_pairs_evidence_is_the_fisher_information_and_the_best_index(name):
    """Against finite differences, and against a fit of point and index at once (scipy)."""
    setting, random = SETTINGS[name], np.random.default_rng(3)
    rig = setting.rig
    points = path(setting, 5, random)
    expected = np.linalg.norm(information(rig, points), axis=1)
    measured = images(rig, points) + 0.01 * PIXEL_STD * random.standard_normal((5, 4))
    for point, row, gain in zip(points, measured, expected, strict=True):
        evidence = gather_evidence(rig, row[:2], row[2:], COVARIANCE, COVARIANCE)
        assert evidence.clue.gain == pytest.approx(gain, rel=2e-3, abs=2e-3)
        if gain < 10.0:
            continue  # The best index of so dull a pair need not be one at all.

        def residual(unknown, row=row):
            return (images(rig.with_target_index(unknown[3]), unknown[:3]) - row) / PIXEL_STD

        best = optimize.least_squares(residual, [*point, rig.target_index], x_scale='jac').x
        suggested = rig.target_index + evidence.clue.innovation / evidence.clue.gain
        assert suggested == pytest.approx(best[3], abs=0.02 / gain)


def test_the_frames_own_index_is_the_papers():
    setting = SETTINGS['oblique along the baseline']
    points = path(setting, 20, np.random.default_rng(4))
    pixels = images(setting.rig, points)
    pixels += 0.02 * np.random.default_rng(5).standard_normal(pixels.shape)
    expected, _ = frame_index(setting.rig, pixels[:, :2], pixels[:, 2:])
    states = run(IndexEstimator(1.35, 0.01), setting.rig, pixels)
    found = np.array([state.frame_index for state in states])
    std = np.array([state.frame_index_std for state in states])
    assert np.abs(found - expected).max() < 0.1 * std.max()


def test_positions_are_as_far_off_as_they_say_while_the_index_is_learnt():
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(8)
    squares = []
    for _ in range(150):
        truth = random.normal(1.355, 0.015)
        points = path(setting, 12, random)
        pixels = images(setting.rig.with_target_index(truth), points)
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        state = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)[-1]
        miss = state.point - points[-1]
        squares.append(miss @ np.linalg.solve(state.covariance, miss))
    assert np.mean(squares) == pytest.approx(3.0, abs=4 * math.sqrt(6 / 150))


def test_it_is_observed_once_the_data_outweigh_the_prior():
    setting, random = SETTINGS['washbowl, corner'], np.random.default_rng(9)
    points = path(setting, 100, random)
    told = np.cumsum(np.sum(information(setting.rig, points) ** 2, axis=1))
    pixels = images(setting.rig, points) + PIXEL_STD * random.standard_normal((100, 4))
    states = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)
    observed = np.array([state.observed for state in states])
    outweighed = told > 1 / 0.015**2
    assert 0 < outweighed.sum() < 100
    assert np.abs(observed.argmax() - outweighed.argmax()) <= 1
    assert observed[observed.argmax() :].all()


def test_in_salt_water_with_a_gradient_it_finds_the_mean_index_and_the_depth():
    """The paper's Sec. 5.3: the washbowl, the target on the floor, salt not stirred."""
    random = np.random.default_rng(19)
    setting = SETTINGS['washbowl, corner']
    layers, step = 20, 0.0245
    errors, scores = {'estimated': [], 'assumed': []}, []
    for _ in range(12):
        surface, floor = np.sort(random.uniform(1.333, 1.38, 2))
        indices = np.linspace(surface, floor, layers)
        truth = mean_index(indices, [step] * layers)
        graded = rig_through(FlatInterface((0, 0, 1), 0.8, (1.0, *indices), [step] * (layers - 1)))
        points = path(setting, 150, random)
        points[:, 2] = 0.8 + layers * step
        pixels = images(graded, points) + PIXEL_STD * random.standard_normal((150, 4))
        states = run(IndexEstimator(1.355, 0.0144), setting.rig, pixels)
        fresh = triangulate(
            setting.rig.with_target_index(1.33), pixels[-30:, :2], pixels[-30:, 2:]
        )
        found = np.array([state.point for state in states[-30:]])
        errors['estimated'].append(np.mean(found - points[-30:], axis=0))
        errors['assumed'].append(np.mean(fresh.points - points[-30:], axis=0))
        scores.append((states[-1].mean - truth) / states[-1].std)
        assert states[-1].observed
    rms = {name: np.sqrt(np.mean(np.square(e))) for name, e in errors.items()}
    assert rms['estimated'] < 0.25 * rms['assumed']
    assert np.mean(np.square(scores)) < 2.5


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ({'prior_mean': 0.9, 'prior_std': 0.01}, 'no refractive index'),
        ({'prior_mean': math.nan, 'prior_std': 0.01}, 'no refractive index'),
        ({'prior_mean': 1.33, 'prior_std': 0.0}, 'prior std'),
        ({'prior_mean': 1.33, 'prior_std': 0.01, 'drift': -1e-4}, 'drift'),
        ({'prior_mean': 1.33, 'prior_std': 0.01, 'gate': 0.0}, 'gate'),
        ({'prior_mean': 1.33, 'prior_std': 0.01, 'parameter_covariance': np.ones(3)}, 'shape'),
        (
            {'prior_mean': 1.33, 'prior_std': 0.01, 'parameter_covariance': np.diag([0, -1, 1])},
            'positive',
        ),
    ],
)
def test_bad_options_are_refused_in_one_line(arguments, message):
    with pytest.raises(TriangulationError, match=message) as caught:
        IndexEstimator(**arguments)
    assert '\n' not in str(caught.value)


def test_bad_calls_are_refused_in_one_line():
    air = rig_through(None)
    rig = SETTINGS['washbowl, corner'].rig
    estimator = IndexEstimator(1.33, 0.01)
    with pytest.raises((TriangulationError, OpticsError), match='no surface'):
        estimator.update(air, (600, 480), (500, 480))
    with pytest.raises(TriangulationError, match='one pair at a time'):
        estimator.update(rig, [(600, 480)] * 2, [(500, 480)] * 2)
    with pytest.raises(TriangulationError, match=r'interface\.distance'):
        IndexEstimator(1.33, 0.01, parameter_covariance=np.eye(2)).update(
            rig, (600, 480), (5, 480)
        )


def test_behind_domes_the_index_is_followed_as_surely_as_it_says():
    random = np.random.default_rng(7)
    rig = RIGS['wide lenses behind domes']
    points = random.uniform([-0.2, -0.2, 1.15], [0.4, 0.2, 1.6], (20, 3))
    squares = []
    for _ in range(60):
        index = random.normal(1.333, 0.01)
        left, right = rig.with_target_index(index).project(points)
        estimator = IndexEstimator(1.333, 0.01)
        for k, pair in enumerate(zip(left, right, strict=True)):
            noisy = (pixel + random.normal(0.0, PIXEL_STD, 2) for pixel in pair)
            state = estimator.update(rig, *noisy, COVARIANCE, COVARIANCE, stamp=k / 30)
        assert state.observed
        squares.append(((state.mean - index) / state.std) ** 2)
    # One set of 60 in a thousand lies outside (chi-squared).
    assert 0.52 < np.mean(squares) < 1.66
