"""The cloud model: generators forward and backward, sliding and recursive forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from binopos_ros.smoothing.cloud import (
    Cloud,
    RecursiveCloud,
    SlidingCloud,
    backward,
    certainty,
    forward,
)
from binopos_ros.smoothing.errors import SmoothingError

CLOUD = Cloud(np.array([1.0, -2.0, 3.0]), np.array([0.5, 1.0, 2.0]), np.array([0.05, 0.1, 0.2]))


@pytest.mark.parametrize('hyper', [0.0, 0.1, 0.5])
@pytest.mark.parametrize('dimensions', [1, 2, 3])
def test_mean_certainty_of_drops_is_two_to_minus_half_the_dimensions(hyper, dimensions):
    cloud = Cloud(np.zeros(dimensions), np.full(dimensions, 2.0), np.full(dimensions, hyper))
    _, values = forward(cloud, 200_000, np.random.default_rng(3))
    standard_error = values.std() / np.sqrt(values.size)
    assert abs(values.mean() - 2.0 ** (-dimensions / 2)) < 4.0 * standard_error


def test_backward_finds_the_cloud_that_the_drops_came_from():
    drops, _ = forward(CLOUD, 400_000, np.random.default_rng(5))
    found = backward(drops)
    np.testing.assert_allclose(found.expectation, CLOUD.expectation, atol=0.01)
    np.testing.assert_allclose(found.entropy, CLOUD.entropy, rtol=0.01)
    np.testing.assert_allclose(found.hyper_entropy, CLOUD.hyper_entropy, rtol=0.15)


def test_hyper_entropy_of_drops_with_light_tails_is_zero():
    even = np.linspace(-1.0, 1.0, 101)[:, None]
    two_sided = np.tile([[-1.0], [1.0]], (50, 1))
    assert backward(two_sided).hyper_entropy == 0.0
    assert backward(even).hyper_entropy >= 0.0


def test_entropy_of_normal_drops_is_their_standard_deviation_not_their_variance():
    drops = np.random.default_rng(1).normal(0.0, 3.0, (100_000, 1))
    assert backward(drops).entropy[0] == pytest.approx(3.0, rel=0.01)


def test_certainty_is_one_at_the_expectation_and_falls_by_one_sigma_as_the_gaussian_does():
    widths = np.array([1.0, 2.0, 4.0])
    assert certainty(np.zeros(3), np.zeros(3), widths) == 1.0
    assert certainty(widths, np.zeros(3), widths) == pytest.approx(np.exp(-1.5))


@pytest.mark.parametrize('drops', [np.zeros((0, 3)), np.zeros(3), 1.0])
def test_backward_refuses_what_is_no_list_of_drops(drops):
    with pytest.raises(SmoothingError, match='shape'):
        backward(drops)


finite = st.floats(-100.0, 100.0, allow_nan=False, width=32)


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.float64, st.tuples(st.integers(2, 30), st.just(3)), elements=finite))
def test_sliding_cloud_is_the_cloud_of_the_last_drops(drops):
    window = SlidingCloud.of(drops[0], 8)
    for drop in drops[1:]:
        window = window.add(drop)
    for ours, expected in zip(window.cloud(), backward(drops[-8:]), strict=True):
        np.testing.assert_allclose(ours, expected, atol=1e-5)


@settings(max_examples=60, deadline=None)
@given(hnp.arrays(np.float64, st.tuples(st.integers(2, 30), st.just(3)), elements=finite))
def test_recursive_cloud_starts_as_the_exact_mean_and_variance_of_all_drops(drops):
    cloud = RecursiveCloud.of(drops[0], 50.0)
    for drop in drops[1:]:
        cloud = cloud.add(drop)
    np.testing.assert_allclose(cloud.expectation, drops.mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(cloud.variance, drops.var(axis=0), atol=1e-7)


def test_recursive_and_sliding_cloud_agree_on_a_long_stationary_stream():
    drops, _ = forward(CLOUD, 4000, np.random.default_rng(8))
    recursive, sliding = RecursiveCloud.of(drops[0], 1000.0), SlidingCloud.of(drops[0], 1000)
    for drop in drops[1:]:
        recursive, sliding = recursive.add(drop), sliding.add(drop)
    one, other = recursive.cloud(), sliding.cloud()
    np.testing.assert_allclose(one.expectation, other.expectation, atol=0.15)
    np.testing.assert_allclose(one.entropy, other.entropy, rtol=0.06)


def test_drop_of_weight_zero_changes_nothing():
    cloud = RecursiveCloud.of(np.ones(3), 10.0).add(np.array([2.0, 0.0, 1.0]))
    same = cloud.add(np.full(3, 1e3), 0.0)
    for before, after in zip(cloud.cloud(), same.cloud(), strict=True):
        np.testing.assert_array_equal(before, after)
