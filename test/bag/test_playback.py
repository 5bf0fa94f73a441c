"""The schedule of a played bag, reading ahead, and the player's options."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.bag import BagError, BagReader, Record
from binopos_ros.bag.playback import PlayerOptions, ReadAhead, Schedule, chosen_topics


class World:
    """A clock that stands until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just('wait'), st.floats(0.0, 10.0)),
        st.tuples(st.just('rate'), st.floats(0.1, 10.0)),
        st.tuples(st.just('pause'), st.just(0.0)),
        st.tuples(st.just('resume'), st.just(0.0)),
    ),
    max_size=20,
)


@settings(deadline=None)
@given(ACTIONS)
def test_bag_time_is_the_sum_of_the_rates_while_it_runs(
    actions: list[tuple[str, float]],
) -> None:
    world = World()
    schedule = Schedule(world, 1.0)
    schedule.start(5 * 10**9)
    expected, rate, running = 5.0, 1.0, True
    for action, value in actions:
        if action == 'wait':
            world.now += value
            expected += value * rate * running
        elif action == 'rate':
            rate = value
            schedule.set_rate(value)
        elif action == 'pause':
            running = False
            schedule.pause()
        else:
            running = True
            schedule.resume()
        assert schedule.now_ns() == pytest.approx(expected * 1e9, abs=100)
    if running:
        assert schedule.world_of(schedule.now_ns()) == pytest.approx(world.now, abs=1e-6)


def test_the_world_time_of_a_stamp_is_known_before_and_after_it() -> None:
    world = World()
    schedule = Schedule(world, 2.0)
    schedule.start(10**9)
    world.now += 3.0
    assert schedule.world_of(10**9) == 100.0
    assert schedule.world_of(21 * 10**9) == 110.0


def records(count: int, size: int) -> Iterator[Record]:
    for number in range(count):
        yield Record('/a', number, bytes(size))


def test_reading_ahead_keeps_the_order_and_the_end() -> None:
    ahead = ReadAhead(lambda: records(5000, 10))
    assert [record.stamp_ns for record in ahead] == list(range(5000))
    ahead.stop()


def test_reading_ahead_is_bounded() -> None:
    read = []

    def watched() -> Iterator[Record]:
        for record in records(100, 8 << 20):
            read.append(record.stamp_ns)
            yield record

    ahead = ReadAhead(watched)
    before = -1
    while before != len(read):
        before = len(read)
        time.sleep(0.05)
    assert 8 <= len(read) <= 10
    assert sum(1 for _ in ahead) == 100
    ahead.stop()


@pytest.mark.parametrize('size', [1, 8 << 20])
def test_reading_ahead_stops_in_the_middle(size: int) -> None:
    ahead = ReadAhead(lambda: records(10**9, size))
    assert next(iter(ahead)).stamp_ns == 0
    before = threading.active_count()
    ahead.stop()
    assert threading.active_count() == before - 1


def test_an_error_while_reading_reaches_the_player() -> None:
    def broken() -> Iterator[Record]:
        yield from records(3, 1)
        raise BagError('the disk is gone')

    ahead = ReadAhead(broken)
    read = []
    with pytest.raises(BagError, match='the disk is gone'):
        read.extend(ahead)
    ahead.stop()


def test_topics_are_chosen_with_or_without_their_slash(
    make_bag: Callable[..., Path], tmp_path: Path
) -> None:
    with BagReader(make_bag(tmp_path / 'bag', pairs=1)) as reader:
        left = '/stereo/left/image_raw/compressed'
        assert chosen_topics(reader, (left[1:],)) == [left]
        assert len(chosen_topics(reader, ())) == 2
        with pytest.raises(BagError, match=r'no topic /nothing in this bag; its topics: /stereo'):
            chosen_topics(reader, ('/nothing',))


def test_topics_are_remapped() -> None:
    options = PlayerOptions(remap=('/stereo/left/image_raw:=left/raw',))
    assert options.published_name('stereo/left/image_raw') == '/left/raw'
    assert options.published_name('AAA') == '/AAA'
    with pytest.raises(BagError, match=r"remap rule '/a=/b': write FROM:=TO"):
        PlayerOptions(remap=('/a=/b',))
