"""A recording smoothed as a whole is what a filter says step by step."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.smoothing import FILTERS, SmoothingError, make_filter, smooth

COUNT = 40
STAMPS = 1.7e9 + np.arange(COUNT) / 30.0
POSITIONS = np.array([0.1, 0.0, 1.2]) + np.random.default_rng(1).normal(0, 1e-3, (COUNT, 3))
COVARIANCES = (
    np.broadcast_to(1e-6 * np.eye(3), (COUNT, 3, 3)) * (1 + np.arange(COUNT) % 3)[:, None, None]
)


@pytest.mark.parametrize('name', FILTERS)
def test_arrays_give_what_steps_give(name: str) -> None:
    positions = POSITIONS.copy()
    positions[7:9] = np.nan
    found = smooth(STAMPS, positions, COVARIANCES, name=name)
    smoother = make_filter(name)
    for k in range(COUNT):
        state = smoother.step(STAMPS[k], positions[k], COVARIANCES[k])
        np.testing.assert_array_equal(found.positions[k], state.position)
        np.testing.assert_array_equal(found.velocities[k], state.velocity)
        np.testing.assert_array_equal(found.covariances[k], state.covariance)
        assert (found.stamps[k], found.certainties[k]) == (state.stamp, state.certainty)
        assert found.reasons[k] == state.reason
    assert list(found.reasons[6:10]) == ['', *2 * ['the position is not finite'], '']


def test_nothing_is_said_before_a_first_position() -> None:
    positions = POSITIONS.copy()
    positions[:3] = np.nan
    found = smooth(STAMPS, positions, COVARIANCES[0])
    assert np.isnan(found.positions[:3]).all()
    assert np.isnan(found.covariances[:3]).all()
    assert np.isfinite(found.positions[3:]).all()


def test_the_waves_part_is_taken_in() -> None:
    with_waves = smooth(STAMPS, POSITIONS, COVARIANCES, media=0.8 * COVARIANCES)
    calm = smooth(STAMPS, POSITIONS, COVARIANCES)
    assert not np.array_equal(with_waves.covariances, calm.covariances)


@pytest.mark.parametrize(
    ('arrays', 'told'),
    [
        ((STAMPS[1:], POSITIONS, COVARIANCES), r'stamps \(39,\) and positions \(40, 3\)'),
        ((STAMPS, POSITIONS[:, :2], COVARIANCES), r'positions \(40, 2\)'),
        ((1.0, POSITIONS[0], COVARIANCES[0]), r'stamps \(\)'),
        ((STAMPS, POSITIONS, 1e-6), r'covariances \(\) must be \(40, 3, 3\)'),
        ((STAMPS, POSITIONS, COVARIANCES, COVARIANCES[:4]), r'media \(4, 3, 3\)'),
    ],
)
def test_shapes_that_do_not_fit_are_told(arrays: tuple, told: str) -> None:
    with pytest.raises(SmoothingError, match=told):
        smooth(*arrays)
    with pytest.raises(SmoothingError, match='no filter is named'):
        smooth(STAMPS, POSITIONS, COVARIANCES, name='kalmann')
