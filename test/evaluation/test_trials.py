"""The trials' physics and bookkeeping: flat water, Fermat against Snell, seeds, paths."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.evaluation.trials.basin import Basin
from binopos_ros.evaluation.trials.paths import KINDS, draw_path
from binopos_ros.evaluation.trials.score import run, run_together
from binopos_ros.evaluation.trials.sequences import (
    TEST_SEED,
    TRAINING_SEED,
    mixed_sequence,
    paper_sequence,
)
from binopos_ros.evaluation.trials.tuning import minimise
from binopos_ros.simulation.waves import WaveField
from binopos_ros.smoothing import make_filter

BASIN = Basin()
TARGETS = np.random.default_rng(1).uniform([-0.3, -0.2, 1.0], [0.4, 0.2, 1.3], (50, 3))
TIMES = np.zeros(50)
ONES = np.ones(50)


def one_wave(amplitude, wavevector, phase=0.0):
    return WaveField(
        np.array([amplitude]), np.array([wavevector]), np.array([10.0]), np.array([phase])
    )


def test_flat_water_gives_the_targets_back():
    left, right = BASIN.pixels(TARGETS, TIMES, one_wave(0.0, [30.0, 0.0]), ONES)
    np.testing.assert_allclose(BASIN.triangulate(left, right), TARGETS, atol=1e-8)


def test_ray_through_flat_water_obeys_snell():
    left, _ = BASIN.pixels(TARGETS, TIMES, one_wave(0.0, [30.0, 0.0]), ONES)
    entry = np.column_stack([left / BASIN.focal_length, np.ones(50)]) * BASIN.surface
    above = np.linalg.norm(entry[:, :2], axis=1) / np.linalg.norm(entry, axis=1)
    way = TARGETS - entry
    below = np.linalg.norm(way[:, :2], axis=1) / np.linalg.norm(way, axis=1)
    np.testing.assert_allclose(above, BASIN.index * below, atol=1e-9)


def test_tilted_surface_shifts_the_target_by_a_quarter_of_depth_times_slope():
    # A wave so long that both cameras see the same slope at its zero crossing.
    slope, length = 0.01, 0.05
    target = np.array([[0.115, 0.0, BASIN.surface + 0.3]])
    wave = one_wave(slope / length, [length, 0.0], -np.pi / 2 - 0.115 * length)
    left, right = BASIN.pixels(target, np.zeros(1), wave, np.ones(1))
    shift = BASIN.triangulate(left, right) - target
    assert abs(shift[0, 0]) == pytest.approx(0.25 * 0.3 * slope, rel=0.1)


def test_shifts_of_left_and_right_that_differ_are_magnified_into_depth():
    sequence = paper_sequence(3)
    errors = np.std(sequence.positions - sequence.truth, axis=0)
    assert 4.0 < errors[2] / errors[:2].mean() < 16.0


def test_covariance_is_that_of_the_noise():
    random = np.random.default_rng(2)
    target = np.tile([0.2, 0.1, 1.2], (4000, 1))
    left, right = BASIN.pixels(target[:1], TIMES[:1], one_wave(0.0, [30.0, 0.0]), ONES[:1])
    noisy = [pixels + random.normal(0.0, 0.1, (4000, 2)) for pixels in (left, right)]
    found = np.cov((BASIN.triangulate(*noisy) - target).T)
    np.testing.assert_allclose(
        found, BASIN.covariance(left, right, 0.1)[0], rtol=0.1, atol=0.05 * found[0, 0]
    )


def test_sequences_are_the_same_for_the_same_seed_and_others_for_another():
    one, same, other = (mixed_sequence(seed) for seed in (7, 7, 12))
    np.testing.assert_array_equal(one.positions, same.positions)
    assert one.kind == other.kind
    assert not np.array_equal(one.positions, other.positions)


def test_training_and_test_never_meet():
    assert TRAINING_SEED + 100_000 < TEST_SEED


@pytest.mark.parametrize('kind', KINDS)
def test_path_keeps_to_the_basin_and_its_derivatives_are_true(kind):
    times = np.linspace(0.0, 10.0, 2001)
    path = draw_path(kind, times, np.random.default_rng(4))
    assert np.all(np.abs(path.position) <= [0.3001, 0.2001, 0.1201])
    step = times[1] - times[0]
    inner = slice(1, -1)
    slope = np.gradient(path.position, step, axis=0)
    np.testing.assert_allclose(slope[inner], path.velocity[inner], atol=6e-3)


def test_running_together_is_running_one_by_one():
    trials = [mixed_sequence(seed, frames=120) for seed in range(5)]
    smoother = make_filter('cloud-kalman')
    for trial, track in zip(trials, run_together(smoother, trials), strict=True):
        np.testing.assert_allclose(track.errors, run(smoother, trial).errors, atol=1e-9)


def test_minimiser_finds_the_bottom_of_a_bowl():
    bottom = np.array([0.2, 0.8, 0.6])
    place, value = minimise(lambda at: float(np.sum((at - bottom) ** 2 * [1, 20, 5])), 3, 301)
    np.testing.assert_allclose(place, bottom, atol=0.02)
    assert value < 1e-3
