"""Images whole or damaged, and halves of images, byte for byte."""

from __future__ import annotations

import array

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.formats import jpeg_fault, known_format, packed, raw_fault, split_raw
from binopos_ros.capture.options import CaptureOptions, RightOptions

JPEG = cv2.imencode('.jpg', np.arange(64 * 48 * 3, dtype=np.uint8).reshape(48, 64, 3))[1].tobytes()


@given(st.integers(0, 20_000))
def test_a_whole_jpeg_passes_with_any_padding(padding):
    assert jpeg_fault(memoryview(JPEG + bytes(padding))) == ''


@given(st.integers(2, len(JPEG) - 1), st.integers(0, 5000))
def test_a_jpeg_that_is_cut_short_is_told(length, padding):
    cut = JPEG[:length]
    if not cut.rstrip(b'\0').endswith(b'\xff\xd9'):
        assert jpeg_fault(memoryview(cut + bytes(padding))) == 'JPEG cut short'


@given(st.binary(max_size=50))
def test_what_is_no_jpeg_is_told(data):
    if not data.startswith(b'\xff\xd8'):
        assert jpeg_fault(memoryview(data)) == 'not a JPEG'


def test_a_raw_image_must_have_all_its_lines():
    assert raw_fault(memoryview(bytes(100)), 10, 10) == ''
    assert raw_fault(memoryview(bytes(101)), 10, 10) == ''
    assert raw_fault(memoryview(bytes(93)), 10, 10) == 'image cut short'


@given(
    st.integers(1, 8), st.integers(1, 8), st.integers(0, 5), st.sampled_from([1, 2, 3]), st.data()
)
def test_halves_of_a_raw_image_join_to_the_whole(width, height, padding, pixel, data):
    step = 2 * width * pixel + padding
    raw = data.draw(st.binary(min_size=step * height, max_size=step * height))
    halves = [packed(half) for half in split_raw(memoryview(raw), step, height, 2 * width, pixel)]
    assert all(isinstance(half, array.array) for half in halves)
    rows = [np.frombuffer(half, np.uint8).reshape(height, width * pixel) for half in halves]
    whole = np.frombuffer(raw, np.uint8).reshape(height, step)[:, : step - padding]
    np.testing.assert_array_equal(np.hstack(rows), whole)


def test_options_that_cannot_work_are_refused():
    with pytest.raises(CaptureError, match="'H264' cannot be passed on; choose one of MJPG"):
        known_format('H264')
    with pytest.raises(CaptureError, match='even width'):
        CaptureOptions(side_by_side=True, width=641)
    with pytest.raises(CaptureError, match='name two cameras'):
        CaptureOptions(right=RightOptions(device='/dev/video0'))
    assert CaptureOptions(side_by_side=True, width=2560).view_size == (1280, 720)
    assert CaptureOptions().tolerance(25.0) == 0.02
    assert CaptureOptions(pair_tolerance=0.004).tolerance(25.0) == 0.004
