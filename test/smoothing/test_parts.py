"""Positions and the parts of their covariances, joined by stamp whatever order they come in."""

from __future__ import annotations

import itertools

import numpy as np

from binopos_ros.smoothing.parts import PARTS, PartsJoiner


def part(value):
    return np.full((3, 3), float(value))


def test_every_order_of_arrival_gives_each_position_its_own_parts():
    events = [
        ('position', 1),
        ('systematic', 1),
        ('medium', 1),
        ('position', 2),
        ('systematic', 2),
    ]
    events.append(('medium', 2))
    for order in itertools.permutations(events):
        if order.index(('position', 1)) > order.index(('position', 2)):
            continue
        joiner, wholes = PartsJoiner(), []
        for name, stamp in order:
            if name == 'position':
                wholes += joiner.add_position(stamp, f'p{stamp}', PARTS)
            else:
                wholes += joiner.add_part(name, stamp, part(stamp))
        assert [(whole.stamp, whole.position) for whole in wholes] == [(1, 'p1'), (2, 'p2')]
        for whole in wholes:
            assert set(whole.parts) == set(PARTS)
            assert all(value[0, 0] == whole.stamp for value in whole.parts.values())


def test_without_anybody_who_tells_of_parts_a_position_waits_for_nothing():
    (whole,) = PartsJoiner().add_position(5, 'p', ())
    assert whole.parts == {}


def test_a_part_that_was_lost_is_taken_from_the_newest_and_holds_nothing_up_for_long():
    joiner = PartsJoiner()
    list(joiner.add_part('systematic', 1, part(1)))
    assert len(list(joiner.add_position(1, 'p1', ['systematic']))) == 1
    assert list(joiner.add_position(2, 'p2', ['systematic'])) == []
    assert list(joiner.add_position(3, 'p3', ['systematic'])) == []
    (late,) = joiner.add_position(4, 'p4', ['systematic'])
    assert late.position == 'p2'
    assert late.parts['systematic'][0, 0] == 1.0
