"""Names and options of the filters: what a node or a person can get wrong."""

from __future__ import annotations

import dataclasses

import pytest

from binopos_ros.smoothing import FILTERS, CloudKalmanFilter, SmoothingError, make_filter
from binopos_ros.smoothing.tuned import TUNED


def test_default_filter_is_the_cloud_kalman():
    assert isinstance(make_filter(), CloudKalmanFilter)


def test_paper_variant_has_a_name_of_its_own_too():
    by_variant = make_filter('cloud-kalman', variant='paper', control=0.5)
    assert by_variant.name == 'cloud-kalman-paper'
    assert by_variant.options.control == 0.5


@pytest.mark.parametrize(
    ('name', 'options', 'message'),
    [
        ('kalmann', {}, 'no filter is named'),
        ('kalman', {'variant': 'paper'}, 'no variant'),
        ('kalman', {'wave_frequency': 2.0}, 'unknown option'),
        ('kalman', {'measurement_std': -1.0}, 'must be from'),
        ('kalman', {'measurement_std': float('nan')}, 'finite'),
        ('kalman', {'measurement_std': '1'}, 'finite'),
        ('kalman', {'max_gap': True}, 'finite'),
        ('median', {'window': 3.5}, 'whole number'),
        ('cloud-kalman', {'wrong_share': 1.0}, 'must be from'),
    ],
)
def test_wrong_name_or_option_is_named_in_one_line(name, options, message):
    with pytest.raises(SmoothingError, match=message) as caught:
        make_filter(name, **options)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('name', FILTERS)
def test_every_option_tells_its_meaning_and_range_and_its_default_is_tuned(name):
    smoother = make_filter(name)
    for item in dataclasses.fields(smoother.options):
        assert item.metadata['description']
        if isinstance(item.default, str):
            assert item.default in item.metadata['choices']
        else:
            low, high = item.metadata['range']
            assert low <= item.default <= high
        assert item.default == TUNED.get(name, {}).get(item.name, item.default)


@pytest.mark.parametrize('name', FILTERS)
def test_options_are_frozen(name):
    options = make_filter(name).options
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.max_gap = 3.0
