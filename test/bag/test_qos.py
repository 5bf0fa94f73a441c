"""Quality of service in bags, against rosbags' reading of it."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2.metadata import dump_qos_v8
from rosbags.rosbag2.metadata import parse_qos as rosbags_parse

from binopos_ros.bag.qos import Qos, format_qos, parse_qos

OFFERS = st.lists(
    st.builds(
        Qos,
        reliability=st.sampled_from(['reliable', 'best_effort']),
        durability=st.sampled_from(['volatile', 'transient_local']),
        history=st.sampled_from(['keep_last', 'keep_all', 'unknown']),
        depth=st.integers(0, 1000),
        deadline_ns=st.integers(1, 10**12),
        lifespan_ns=st.integers(1, 10**12),
    ),
    max_size=3,
)


@settings(deadline=None)
@given(OFFERS)
def test_both_spellings_come_back(offers: list[Qos]) -> None:
    words = format_qos(offers)
    assert parse_qos(words) == offers
    theirs = rosbags_parse(words if offers else '')
    assert [profile.reliability.name.lower() for profile in theirs] == [
        offer.reliability for offer in offers
    ]
    numbers = dump_qos_v8(theirs)
    assert parse_qos(numbers) == offers


def test_unlimited_durations_are_one_thing_in_all_their_spellings() -> None:
    entry = '- history: 1\n  depth: 5\n  reliability: 2\n  durability: 2\n  deadline: {{{0}}}\n'
    for spelling in (
        'sec: 0, nsec: 0',
        'sec: 9223372036, nsec: 854775807',
        'sec: 2147483647, nsec: 4294967295',
    ):
        (offer,) = parse_qos(entry.format(spelling))
        assert offer == Qos('best_effort', 'volatile', depth=5)


@pytest.mark.parametrize('text', ['', '[]', 'nonsense', '- 1', '{', '- {deadline: soon}', '7'])
def test_what_cannot_be_read_is_no_offer(text: str) -> None:
    assert parse_qos(text) == []
