"""Bad, late, repeated and lost measurements: no filter is poisoned; only other shapes raise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from binopos_ros.smoothing import FILTERS, SmoothingError, make_filter

COVARIANCE = np.diag([1e-8, 1e-8, 1e-6])
RATE = 30.0
PLACE = np.array([0.1, -0.05, 1.2])
NOISE = np.random.default_rng(4).normal(size=(4000, 3)) * [1e-4, 1e-4, 1e-3]

every_filter = pytest.mark.parametrize('name', FILTERS)


def assert_sane(state):
    assert np.isfinite(state.stamp)
    assert np.all(np.isfinite(state.position))
    assert np.all(np.isfinite(state.velocity))
    assert np.all(np.isfinite(state.covariance))
    assert state.covariance.shape == (6, 6)
    np.testing.assert_allclose(state.covariance, state.covariance.T, atol=1e-9)
    assert np.linalg.eigvalsh(state.covariance).min() > -1e-9 * np.trace(state.covariance)
    assert 0.0 <= state.certainty <= 1.0


def feed(smoother, start, count, place=PLACE):
    """Feed `count` good frames from frame number `start`; return the last state."""
    for number in range(start, start + count):
        state = smoother.step(number / RATE, place + NOISE[number % 4000], COVARIANCE)
        assert_sane(state)
    return state


def assert_recovered(state, place=PLACE):
    assert state.reason == ''
    assert np.linalg.norm(state.position - place) < 0.01


BAD = {
    'nan': ([np.nan, 0.0, 1.0], COVARIANCE, 'not finite'),
    'inf': ([np.inf, 0.0, 1.0], COVARIANCE, 'not finite'),
    'nan covariance': (PLACE, COVARIANCE * np.nan, 'not finite'),
    'inf covariance': (PLACE, COVARIANCE + np.inf, 'not finite'),
    'negative covariance': (PLACE, -COVARIANCE, 'negative'),
    'indefinite covariance': (PLACE, np.array([[1, 2, 0], [2, 1, 0], [0, 0, 1.0]]), 'negative'),
    'singular covariance': (PLACE, np.diag([1.0, 1.0, 0.0]), 'singular'),
    'zero covariance': (PLACE, np.zeros((3, 3)), 'singular'),
    'asymmetric covariance': (PLACE, np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]), 'symmetric'),
    'ten metres off': (PLACE + 10.0, COVARIANCE, 'from the prediction'),
}


@every_filter
@pytest.mark.parametrize(
    ('position', 'covariance'),
    [([1.0, 2.0], COVARIANCE), (PLACE, np.eye(6)), (PLACE, 1e-6), (PLACE[None], COVARIANCE)],
)
def test_arrays_of_another_shape_are_refused_and_leave_no_trace(name, position, covariance):
    smoother, untouched = make_filter(name), make_filter(name)
    feed(smoother, 0, 40)
    with pytest.raises(SmoothingError, match='shape'):
        smoother.step(40 / RATE, position, covariance)
    feed(untouched, 0, 40)
    np.testing.assert_array_equal(
        feed(smoother, 41, 30).position, feed(untouched, 41, 30).position
    )


@every_filter
@pytest.mark.parametrize('kind', BAD)
def test_bad_measurement_is_named_and_leaves_no_trace(name, kind):
    position, covariance, reason = BAD[kind]
    smoother, untouched = make_filter(name), make_filter(name)
    feed(smoother, 0, 40)
    feed(untouched, 0, 40)
    foretold = untouched.predict(40 / RATE)
    state = smoother.step(40 / RATE, position, covariance)
    assert_sane(state)
    assert reason in state.reason
    assert state.certainty == 0.0
    np.testing.assert_allclose(state.position, foretold.position, atol=1e-12)
    np.testing.assert_allclose(
        feed(smoother, 41, 30).position, feed(untouched, 41, 30).position, atol=1e-12
    )


@every_filter
@pytest.mark.parametrize('kind', sorted(set(BAD) - {'ten metres off'}))
def test_bad_first_measurement_gives_an_unknown_state(name, kind):
    position, covariance, reason = BAD[kind]
    smoother = make_filter(name)
    state = smoother.step(0.0, position, covariance)
    assert_sane(state)
    assert reason in state.reason
    assert not state.known
    assert feed(smoother, 1, 30).known


@every_filter
@pytest.mark.parametrize('stamp', [np.nan, np.inf, -np.inf])
def test_stamp_that_is_no_number_is_refused(name, stamp):
    smoother = make_filter(name)
    feed(smoother, 0, 20)
    state = smoother.step(stamp, PLACE, COVARIANCE)
    assert_sane(state)
    assert 'stamp' in state.reason
    assert_recovered(feed(smoother, 20, 5))


@every_filter
def test_repeated_stamp_is_refused(name):
    smoother = make_filter(name)
    before = feed(smoother, 0, 20)
    state = smoother.step(19 / RATE, PLACE + 0.02, COVARIANCE)
    assert 'already used' in state.reason
    np.testing.assert_array_equal(state.position, before.position)


@every_filter
def test_late_measurements_count_as_if_they_had_come_in_order(name):
    in_order, shuffled = make_filter(name), make_filter(name)
    expected = feed(in_order, 0, 60)
    order = np.arange(60)
    for start in (10, 25, 40):
        order[start : start + 5] = start + np.array([2, 0, 1, 4, 3])
    for number in order:
        state = shuffled.step(number / RATE, PLACE + NOISE[number], COVARIANCE)
        assert state.reason == ''
    assert state.stamp == 59 / RATE
    np.testing.assert_allclose(state.position, expected.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.covariance, expected.covariance, rtol=1e-9, atol=1e-15)


@every_filter
def test_measurement_later_than_the_allowed_delay_is_refused(name):
    smoother = make_filter(name, max_delay=0.2)
    before = feed(smoother, 0, 60)
    state = smoother.step(40.5 / RATE, PLACE, COVARIANCE)
    assert 'before the newest' in state.reason
    np.testing.assert_array_equal(state.position, before.position)


@every_filter
def test_clock_that_jumps_back_for_good_is_followed_within_a_second(name):
    smoother = make_filter(name)
    feed(smoother, 3000, 60)
    state = feed(smoother, 0, 30, PLACE + 0.3)
    assert_recovered(state, PLACE + 0.3)
    assert state.stamp == pytest.approx(29 / RATE)


@every_filter
def test_one_stamp_far_ahead_does_not_stop_the_filter(name):
    smoother = make_filter(name)
    feed(smoother, 0, 30)
    assert_sane(smoother.step(3600.0, PLACE, COVARIANCE))
    assert_recovered(feed(smoother, 30, 30))


@every_filter
def test_after_an_hour_without_measurements_the_filter_starts_afresh(name):
    smoother = make_filter(name)
    feed(smoother, 0, 30)
    assert_sane(smoother.predict(3600.0))
    state = smoother.step(3600.0, PLACE + 0.5, COVARIANCE)
    assert_recovered(state, PLACE + 0.5)


@every_filter
def test_target_that_is_moved_by_ten_metres_for_good_is_followed_within_a_second(name):
    smoother = make_filter(name)
    feed(smoother, 0, 60)
    state = smoother.step(60 / RATE, PLACE + 10.0, COVARIANCE)
    assert 'from the prediction' in state.reason
    assert_recovered(feed(smoother, 61, 30, PLACE + 10.0), PLACE + 10.0)


@every_filter
def test_prediction_changes_nothing_and_grows_less_certain(name):
    smoother, untouched = make_filter(name), make_filter(name)
    feed(smoother, 0, 40)
    feed(untouched, 0, 40)
    traces = [np.trace(smoother.predict(40 / RATE + t).covariance[:3, :3]) for t in (0, 0.5, 2)]
    assert traces[0] < traces[1] < traces[2]
    np.testing.assert_array_equal(feed(smoother, 40, 1).position, feed(untouched, 40, 1).position)


@every_filter
@pytest.mark.parametrize('stamp', [np.nan, -5.0, 1e18, np.inf])
def test_prediction_for_any_stamp_is_finite(name, stamp):
    smoother = make_filter(name)
    assert_sane(smoother.predict(stamp))
    feed(smoother, 0, 10)
    assert_sane(smoother.predict(stamp))


@every_filter
def test_reset_forgets(name):
    smoother = make_filter(name)
    first = feed(smoother, 0, 20)
    smoother.reset()
    assert not smoother.predict(1.0).known
    np.testing.assert_array_equal(feed(smoother, 0, 20).position, first.position)


#: Filters that know one motion and weigh no position.
PLAIN = ('kalman', 'sage-husa', 'cloud-kalman-paper')
anything = st.one_of(
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e-300]),
    st.floats(-20.0, 20.0),
)


@pytest.mark.parametrize('name', FILTERS)
@settings(max_examples=25, deadline=None)
@example(steps=[(9.0, [0.0, 0.0, 5.0], 1.0)])
@given(
    steps=st.lists(
        st.tuples(anything, st.lists(anything, min_size=3, max_size=3), anything),
        min_size=1,
        max_size=8,
    )
)
def test_no_input_whatsoever_breaks_a_filter(name, steps):
    smoother = make_filter(name)
    feed(smoother, 0, 5)
    for stamp, position, scale in steps:
        with np.errstate(all='ignore'):
            covariance = scale * COVARIANCE
        assert_sane(smoother.step(stamp, position, covariance))
    # Of a wrong object a second before, plain filters keep 4 m/s, and they swing through.
    frames = 150 if name in PLAIN else 45
    for number in range(300, 300 + frames):
        state = smoother.step(number / RATE, PLACE + NOISE[number], COVARIANCE)
        assert_sane(state)
    assert_recovered(state)
