"""Stamps in ROS time: constant against a truth that the converter cannot see."""

from __future__ import annotations

import random
import time

from hypothesis import given, settings
from hypothesis import strategies as st

from binopos_ros.capture.clock import KernelToRos


class Clocks:
    """Two clocks that tick together; every reading takes a while, now and then a long one."""

    def __init__(self, offset, seed=0):
        self.now, self.offset, self.random = 10**12, offset, random.Random(seed)

    def _pass(self):
        held_up = self.random.random() < 0.1
        self.now += self.random.randint(50, 5_000_000 if held_up else 400)

    def monotonic(self):
        self._pass()
        return self.now

    def ros(self):
        self._pass()
        return self.now + self.offset


def converter(clocks):
    return KernelToRos(clocks.ros, clocks.monotonic)


@given(st.integers(-(10**18), 10**18), st.integers(0, 1000))
@settings(max_examples=50, deadline=None)
def test_the_offset_is_found_to_the_time_of_a_reading(offset, seed):
    clocks = Clocks(offset, seed)
    found = converter(clocks)
    for _ in range(5):
        found.measure()
    assert abs(found.offset_ns - offset) <= 1000
    assert abs(found.offset_ns - offset) <= 2 * found.uncertainty_ns


def test_an_hour_of_measurements_moves_no_stamp():
    clocks = Clocks(1_700_000_000 * 10**9)
    found = converter(clocks)
    for _ in range(10):
        found.measure()
    settled = found.offset_ns
    for _ in range(3600):
        clocks.now += 10**9
        found.measure()
    assert found.steps == 0
    assert abs(found.offset_ns - settled) < 500
    assert abs(found.offset_ns - clocks.offset) < 500


def test_a_step_of_the_wall_clock_is_followed_at_the_next_measurement():
    clocks = Clocks(0)
    found = converter(clocks)
    for step in (37 * 10**9, -5 * 10**6):
        clocks.offset += step
        before = found.steps
        found.measure()
        assert found.steps > before
        assert abs(found.offset_ns - clocks.offset) < 1000


def test_the_offset_for_exposure_is_in_seconds():
    found = converter(Clocks(0))
    assert found.stamp_ns(5, -0.0125) - found.stamp_ns(5) == -12_500_000


def test_the_machines_own_clocks_agree():
    found = KernelToRos(time.time_ns)
    before = time.time_ns()
    stamp = found.stamp_ns(time.monotonic_ns())
    after = time.time_ns()
    slack = found.uncertainty_ns + 1
    assert before - slack <= stamp <= after + slack
