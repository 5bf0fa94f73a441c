"""Pairing of left and right by their stamps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.pairing import Pair, PairMatcher, Unpaired

PERIOD = 33_333_333


def run(matcher, arrivals):
    events = [
        event for side, stamp in arrivals for event in matcher.add(side, stamp, (side, stamp))
    ]
    return events + list(matcher.flush())


def pairs_of(events):
    return [(e.left[1], e.right[1]) for e in events if isinstance(e, Pair)]


@st.composite
def recordings(draw):
    """Two free-running cameras: an offset, jitter, losses, and either side arriving late."""
    count = draw(st.integers(1, 30))
    offset = draw(st.integers(-PERIOD // 4, PERIOD // 4))
    arrivals = []
    newest = {'left': 0, 'right': 0}
    for k in range(count):
        for side, shift in (('left', 0), ('right', offset)):
            if draw(st.booleans()) or draw(st.booleans()):
                jitter = draw(st.integers(-PERIOD // 10, PERIOD // 10))
                delay = draw(st.integers(0, 3 * PERIOD))
                stamp = 10**18 + k * PERIOD + shift + jitter
                # A topic keeps its order; left and right need not keep theirs.
                newest[side] = max(newest[side] + 1, stamp + delay)
                arrivals.append((newest[side], side, stamp))
    return [(side, stamp) for _, side, stamp in sorted(arrivals)]


@given(recordings())
def test_every_item_ends_in_one_pair_or_is_reported_once(arrivals):
    events = run(PairMatcher(PERIOD // 2), arrivals)
    ends = [item for e in events if isinstance(e, Pair) for item in (e.left, e.right)]
    ends += [e.item for e in events if isinstance(e, Unpaired)]
    assert sorted(ends) == sorted(arrivals)


@given(recordings())
def test_a_pair_never_spans_more_than_the_tolerance(arrivals):
    for left, right in pairs_of(run(PairMatcher(PERIOD // 2), arrivals)):
        assert abs(left - right) <= PERIOD // 2


@given(recordings())
def test_frames_that_both_cameras_saw_are_paired_whatever_arrives_first(arrivals):
    frame = {'left': {}, 'right': {}}
    for side, stamp in arrivals:
        frame[side][round((stamp - 10**18) / PERIOD)] = stamp
    both = set(frame['left']) & set(frame['right'])
    close = {(frame['left'][k], frame['right'][k]) for k in both}
    close = {pair for pair in close if abs(pair[0] - pair[1]) < PERIOD * 0.36}
    found = set(pairs_of(run(PairMatcher(PERIOD // 2), arrivals)))
    assert close <= found


def test_the_tolerance_is_half_of_the_measured_frame_period():
    matcher = PairMatcher()
    run_of_left = [('left', k * PERIOD) for k in range(1, 20)]
    for side, stamp in run_of_left:
        list(matcher.add(side, stamp, None))
    assert matcher.tolerance == PERIOD // 2


@pytest.mark.parametrize('lost', ['every other, in turn', 'half of them, at random'])
def test_lost_frames_do_not_pair_images_of_different_instants(lost):
    """A camera that loses every other frame seems to run at half the rate."""
    random = np.random.default_rng(5)
    arrivals = []
    for k in range(400):
        for parity, side in enumerate(('left', 'right')):
            faulty = 40 <= k < 120
            in_turn = k % 2 == parity
            if not faulty or (in_turn if lost.startswith('every') else random.uniform() < 0.5):
                arrivals.append((side, 10**18 + k * PERIOD + int(random.normal(0, PERIOD / 50))))
    pairs = pairs_of(run(PairMatcher(), arrivals))
    assert all(abs(left - right) < PERIOD / 2 for left, right in pairs)
    assert len([pair for pair in pairs if pair[0] > 10**18 + 119.5 * PERIOD]) == 280


def test_the_tolerance_follows_a_frame_rate_that_was_changed():
    matcher = PairMatcher()
    stamp = 0
    for period in (PERIOD, 3 * PERIOD):
        for _ in range(300):
            stamp += period
            list(matcher.add('left', stamp, None))
        assert matcher.tolerance == period // 2


def test_a_wild_stamp_costs_a_few_pairs_and_no_more():
    for jump in (0.3, 0.9, 5.0, 1e5, -0.5, -5.0):
        arrivals = [(side, 10**18 + k * PERIOD) for k in range(200) for side in ('left', 'right')]
        arrivals[101] = ('right', arrivals[101][1] + int(jump * 1e9))
        pairs = pairs_of(run(PairMatcher(), arrivals))
        assert len(pairs) >= 200 - 2 - min(abs(jump), 1.0) * 1e9 / PERIOD
        assert all(abs(left - right) < PERIOD / 2 for left, right in pairs)


def test_a_repeated_stamp_is_reported_and_the_pair_is_kept():
    events = run(PairMatcher(1000), [('left', 5), ('left', 5), ('right', 5)])
    assert pairs_of(events) == [(5, 5)]
    assert [e.reason for e in events if isinstance(e, Unpaired)] == ['the left stamp was repeated']


def test_a_recording_that_starts_again_is_paired_again():
    first = [(side, 10**10 + k) for k in range(3) for side in ('left', 'right')]
    events = run(PairMatcher(0), [*first, ('left', 99 * 10**9), *first])
    assert len(pairs_of(events)) == 6
    assert [e.reason for e in events if isinstance(e, Unpaired)] == ['the stamps jumped back']


def test_a_camera_that_stays_silent_costs_bounded_memory():
    matcher = PairMatcher(1000)
    lost = sum(1 for k in range(1000) for _ in matcher.add('left', k * PERIOD, k))
    assert 900 <= lost < 1000
