"""Pictures as they arrive: the newest pair first, and each picture and pair counted once."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.arrivals import OVERTAKEN, ArrivalOptions, Arrivals
from binopos_ros.parameters import ParameterError

PERIOD = 33_333_333
SECOND = 10**9


class Desk:
    """Arrivals with a clock of their own, and a worker who takes when it is told to."""

    def __init__(self, **options) -> None:
        self.now = 0.0
        self.arrivals = Arrivals(ArrivalOptions(**options), lambda: self.now)
        self.settled = []

    def add(self, side, stamp):
        self.settled += self.arrivals.add(side, stamp, (side, stamp))

    def pair(self, number):
        for side in ('left', 'right'):
            self.add(side, SECOND + number * PERIOD)

    def look(self, seconds):
        self.now += seconds
        self.settled += self.arrivals.look()

    def work(self, outcome=''):
        """Take the next work, settle it, and return its (side, stamp)."""
        if not self.arrivals._ready:
            return ()
        work = self.arrivals.take()
        items = tuple(picture.item for picture in work)
        for picture in work:
            self.arrivals.settle(picture, outcome)
            self.settled.append(picture)
        return items


def both(number):
    return tuple((side, SECOND + number * PERIOD) for side in ('left', 'right'))


def test_of_the_pairs_that_wait_the_newest_is_taken_and_the_others_are_left_out_whole():
    desk = Desk()
    for number in range(5):
        desk.pair(number)
    assert sorted(desk.work()) == sorted(both(4))
    assert desk.work() == ()
    assert [picture.outcome for picture in desk.settled] == [OVERTAKEN] * 8 + ['', '']
    ledger = desk.arrivals.pairs
    assert (ledger.taken, ledger.used, dict(ledger.lost)) == (5, 1, {OVERTAKEN: 4})


def test_a_pair_that_is_being_worked_on_is_not_overtaken():
    desk = Desk()
    desk.pair(0)
    work = desk.arrivals.take()
    desk.pair(1)
    assert not desk.settled
    for picture in work:
        desk.arrivals.settle(picture, '')
    assert sorted(desk.work()) == sorted(both(1))
    assert desk.arrivals.pairs.used == 2


def test_without_newest_first_every_pair_is_worked_on_in_order():
    desk = Desk(newest_first=False)
    for number in range(20):
        desk.pair(number)
    assert [sorted(desk.work()) for _ in range(20)] == [sorted(both(k)) for k in range(20)]
    assert desk.arrivals.pairs.used == 20


def test_a_lonely_picture_waits_for_its_partner_once_and_those_behind_it_do_not():
    desk = Desk()
    desk.add('left', SECOND)
    desk.look(0.05)
    assert desk.work() == ()
    desk.look(0.06)
    assert desk.work() == (('left', SECOND),)
    desk.add('left', SECOND + PERIOD)
    assert desk.work() == (('left', SECOND + PERIOD),)
    # The other camera comes up: pairs again.
    desk.add('right', SECOND + PERIOD)
    assert desk.work() == (('right', SECOND + PERIOD),)
    desk.add('left', SECOND + 2 * PERIOD)
    assert desk.work() == ()
    desk.add('right', SECOND + 2 * PERIOD)
    assert len(desk.work()) == 2
    assert desk.arrivals.pairs.taken == desk.arrivals.pairs.used == 2


def test_a_picture_whose_partner_was_lost_gives_way_to_the_next_pair():
    desk = Desk()
    desk.add('left', SECOND)
    desk.pair(1)
    assert sorted(desk.work()) == sorted(both(1))
    (alone, *_) = desk.settled
    assert (alone.side, alone.outcome) == ('left', 'no partner')
    assert desk.arrivals.unpaired == {'left': 1}


def test_a_pair_of_which_one_gives_nothing_is_lost_for_its_reason():
    desk = Desk()
    desk.pair(0)
    left, right = desk.arrivals.take()
    desk.arrivals.settle(left, '')
    desk.arrivals.settle(right, 'nothing red')
    assert dict(desk.arrivals.pairs.lost) == {'right: nothing red': 1}


@pytest.mark.parametrize(
    ('stamps', 'reason'),
    [
        ([0], "the stamp is zero: the camera's driver sets none"),
        ([7, 7], 'the stamp was repeated'),
    ],
)
def test_stamps_that_cannot_be_are_told(stamps, reason):
    desk = Desk()
    for stamp in stamps:
        desk.add('left', stamp)
    assert [picture.outcome for picture in desk.settled] == [reason]


def test_who_is_closed_waits_no_more():
    desk = Desk()
    desk.arrivals.close()
    assert desk.arrivals.take() is None


def test_a_transport_that_is_not_known_is_refused():
    with pytest.raises(ParameterError, match='image_transport'):
        ArrivalOptions(image_transport='theora')


@st.composite
def days(draw):
    """What happens in a desk's day: pictures, lost and repeated ones, looks, and work or none."""
    events = []
    for number in range(draw(st.integers(1, 25))):
        sides = draw(st.permutations(('left', 'right')))
        for side in sides:
            if draw(st.integers(0, 9)) > 1:
                events.append(('add', side, SECOND + number * PERIOD))
                if draw(st.integers(0, 9)) == 0:
                    events.append(events[-1])
            if draw(st.integers(0, 3)) == 0:
                events.append(('look', draw(st.sampled_from((0.01, 0.2)))))
        if draw(st.booleans()):
            events.append(('work', draw(st.sampled_from(('', 'nothing red')))))
    return events


@given(days(), st.booleans())
def test_every_picture_and_every_pair_ends_once(events, newest_first):
    desk = Desk(newest_first=newest_first, pair_tolerance=0.005)
    added = 0
    for verb, *arguments in events:
        added += verb == 'add'
        getattr(desk, verb)(*arguments)
    # Long after the last picture nothing waits.
    desk.look(10.0)
    while desk.work():
        pass
    assert len(desk.settled) == len({id(picture) for picture in desk.settled}) == added
    assert all(picture.item is None for picture in desk.settled)
    ledger = desk.arrivals.pairs
    stamps = [
        {e[2] for e in events if e[0] == 'add' and e[1] == side} for side in ('left', 'right')
    ]
    assert ledger.taken == len(stamps[0] & stamps[1])
    assert ledger.taken == ledger.used + ledger.lost.total()


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(*[st.floats(0.0, 0.9)] * 2), min_size=2, max_size=12),
    st.lists(st.floats(0.01, 5.0), min_size=12, max_size=12),
)
def test_whatever_work_takes_it_begins_less_than_two_periods_after_the_stamp(delays, takes):
    """delays are those of each pair's pictures, and takes what each work takes, in periods."""
    desk, free = Desk(), 0.0
    coming = sorted(
        (number + delay, side, number)
        for number, each in enumerate(delays)
        for side, delay in zip(('left', 'right'), each, strict=True)
    )
    for (now, side, number), (following, *_) in itertools.pairwise(coming):
        desk.add(side, SECOND + number * PERIOD)
        begin = max(free, now)
        if begin <= following and (work := desk.work()):
            stamp = work[0][1]
            assert begin - (stamp - SECOND) / PERIOD < 2.0
            free = begin + takes.pop()
