"""What the middleware says of each message: what is missing before it, and when it was sent."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed')

from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.nodes.losses import Counted, Gaps


@given(st.lists(st.booleans(), min_size=1))
def test_what_is_missing_between_messages_that_came_is_counted(came):
    gaps = Gaps()
    numbers = [number for number, here in enumerate(came, 1) if here]
    lost = sum(gaps.add(number) for number in numbers)
    # What went before the first is not known, nor what comes after the last.
    assert lost == (numbers[-1] - numbers[0] + 1 - len(numbers) if numbers else 0)


def test_a_publisher_that_starts_again_and_one_beside_it_have_lost_nothing():
    gaps = Gaps()
    numbers = [41, 42, 43, 1, 2, 3, 44, 4, 45, 46, 5]
    assert sum(map(gaps.add, numbers)) == 0


def info(number, sent, came):
    return {
        'publication_sequence_number': number,
        'source_timestamp': round(sent * 1e9),
        'received_timestamp': round(came * 1e9),
    }


@pytest.mark.parametrize('as_tuple', [True, False], ids=['EventsExecutor', 'others'])
def test_a_callback_gets_its_message_and_the_losses_before_it(as_tuple):
    taken, lost = [], []
    counted = Counted(taken.append, lost.append)
    for number in (3, 4, 9):
        arguments = (f'message {number}', info(number, 5.0, 5.001))
        counted(arguments) if as_tuple else counted(*arguments)
    assert taken == ['message 3', 'message 4', 'message 9']
    assert lost == [4]


@pytest.mark.parametrize(
    ('offset', 'said'),
    [(0.0, ''), (0.05, ''), (3.2, '3.2 s ahead of'), (-4.5, '4.5 s behind'), (-0.3, '')],
)
def test_a_clock_that_differs_is_told_with_its_remedy(offset, said):
    counted = Counted(lambda _: None, lambda _: None)
    for number, delay in enumerate((0.002, 1.7, 0.01)):
        counted((None, info(number, 100.0 + number + offset, 100.0 + number + delay)))
    told = counted.clock_trouble()
    assert said in told
    assert bool(told) == bool(said)
    assert not told or 'chrony' in told
    # Nothing came since.
    assert counted.clock_trouble() == ''
