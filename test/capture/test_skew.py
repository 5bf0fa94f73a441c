"""Skew measured against known clocks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.formats import split_side_by_side
from binopos_ros.capture.skew import SkewMeter

PERIOD = 1 / 30


def feed(meter, left, right):
    """Hand both cameras' stamps (s) over in the order of their arrival."""
    arrivals = [(stamp, 'left') for stamp in left] + [(stamp, 'right') for stamp in right]
    for stamp, side in sorted(arrivals):
        meter.add(side, round(stamp * 1e9))


def test_triggered_cameras_have_the_skew_of_their_trigger():
    left = np.arange(300) * PERIOD
    jitter = np.random.default_rng(0).normal(0.0, 20e-6, 300)
    meter = SkewMeter(PERIOD / 2)
    feed(meter, left, left + 0.5e-3 + jitter)
    skew = meter.skew()
    assert skew.pairs == meter.paired == 300
    assert skew.median == pytest.approx(0.5e-3, abs=5e-6)
    assert skew.percentile_99 == pytest.approx(
        np.percentile(np.abs(0.5e-3 + jitter), 99), abs=1e-6
    )
    assert abs(skew.drift) < 2e-6
    assert meter.unpaired == {'left': 0, 'right': 0}


@pytest.mark.parametrize('drift', [-400e-6, 50e-6, 400e-6])
def test_the_drift_of_free_running_cameras_is_found_across_changes_of_partner(drift):
    # At 400 ppm the skew runs through a whole period within the window.
    left = np.arange(3000) * PERIOD
    right = 0.4 * PERIOD + np.arange(3000) * PERIOD * (1 + drift)
    meter = SkewMeter(PERIOD / 2, window=3000)
    feed(meter, left, right)
    assert meter.skew().drift == pytest.approx(drift, rel=0.02)
    assert meter.skew().percentile_99 <= PERIOD / 2 + 1e-9


def test_frames_without_a_partner_are_counted_by_side():
    left = np.arange(100) * PERIOD
    meter = SkewMeter(PERIOD / 2)
    right = np.delete(left + 1e-3, [10, 11, 50])
    feed(meter, np.delete(left, [70]), right)
    assert meter.paired == 96
    assert meter.unpaired == {'left': 3, 'right': 1}


def test_a_silent_camera_leaves_the_other_unpaired_without_growing():
    meter = SkewMeter(PERIOD / 2)
    feed(meter, np.arange(1000) * PERIOD, [])
    assert meter.skew() is None
    assert meter.unpaired['left'] >= 900
    meter.forget()
    assert meter.unpaired['left'] == 1000


def test_beyond_the_tolerance_nothing_pairs():
    meter = SkewMeter(1e-3)
    left = np.arange(50) * PERIOD
    feed(meter, left, left + 2e-3)
    assert meter.paired == 0


@given(
    st.lists(st.integers(0, 10**9), unique=True, max_size=60),
    st.lists(st.integers(0, 10**9), unique=True, max_size=60),
    st.integers(0, 10**8),
)
def test_every_frame_is_paired_once_or_counted(left, right, tolerance_ns):
    meter = SkewMeter(tolerance_ns * 1e-9)
    for stamp, side in sorted([(s, 'left') for s in left] + [(s, 'right') for s in right]):
        meter.add(side, stamp)
    meter.forget()
    assert meter.paired + meter.unpaired['left'] == len(left)
    assert meter.paired + meter.unpaired['right'] == len(right)


def test_too_few_pairs_have_no_drift():
    meter = SkewMeter(PERIOD / 2)
    feed(meter, np.arange(5) * PERIOD, np.arange(5) * PERIOD)
    assert math.isnan(meter.skew().drift)


def test_a_side_by_side_picture_splits_into_its_halves_without_a_copy():
    picture = np.random.default_rng(0).integers(0, 256, (4, 12, 3), np.uint8)
    left, right = split_side_by_side(picture)
    np.testing.assert_array_equal(np.hstack([left, right]), picture)
    assert left.base is picture
    assert right.base is picture
    with pytest.raises(CaptureError, match='odd width'):
        split_side_by_side(picture[:, :11])
