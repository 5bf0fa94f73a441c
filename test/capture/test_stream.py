"""Frames out of the buffers: what is told of each, what is copied, what goes wrong."""

from __future__ import annotations

import array
import errno
import time
import tracemalloc
from itertools import islice

import numpy as np
import pytest

from binopos_ros.capture import errors
from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.stream import copied
from binopos_ros.capture.v4l2 import Device

PATH = '/dev/video0'


def test_frames_come_in_order_with_their_bytes_and_stamps(kernel, camera, take):
    camera.frames.extend(take(k, data=b'%d' % k * (k + 1)) for k in range(9))
    seen = []
    with (
        Device(PATH, kernel) as device,
        device.stream(buffers=3, interrupted=lambda: len(seen) == 9) as stream,
    ):
        for frame in stream:
            seen.append((frame.sequence, bytes(frame.data), frame.stamp_ns))
            assert frame.stamped_by_kernel
            assert not frame.corrupt
    assert seen == [(k, b'%d' % k * (k + 1), 1_000_000_000 + 33_000_000 * k) for k in range(9)]


def test_gaps_in_the_sequence_are_lost_frames(kernel, camera, take):
    counts = [7, 8, 11, 12, (1 << 32) - 1, 0, 1, 4, 2, 3]
    camera.frames.extend(take(k) for k in counts)
    with Device(PATH, kernel) as device, device.stream() as stream:
        lost = [next(stream).lost for _ in counts]
    # A jump of half the span and a count that goes back are restarts, not losses.
    assert lost == [0, 0, 2, 0, 0, 0, 0, 2, 0, 0]


def test_damaged_frames_are_told_apart(kernel, camera, take):
    camera.frames.extend([take(0), take(1, flags=v4l2.BUF_FLAG_ERROR), take(2)])
    with Device(PATH, kernel) as device, device.stream() as stream:
        assert [next(stream).corrupt for _ in range(3)] == [False, True, False]


def test_a_stamp_of_another_clock_is_replaced_by_the_arrival(kernel, camera, take):
    frame = take(0, stamp_ns=5)
    frame.flags = 0
    camera.frames.append(frame)
    with Device(PATH, kernel) as device, device.stream() as stream:
        before = time.monotonic_ns()
        got = next(stream)
        assert not got.stamped_by_kernel
        assert before <= got.stamp_ns <= time.monotonic_ns()


def test_a_frame_is_a_view_of_the_drivers_buffer(kernel, camera, take):
    size = kernel.buffer_size = 1 << 20
    camera.frames.extend([take(0, b'a' * size), take(1, b'b' * size)])
    with Device(PATH, kernel) as device, device.stream() as stream:
        tracemalloc.start()
        try:
            first = next(stream).data
            assert tracemalloc.get_traced_memory()[1] < size // 16
        finally:
            tracemalloc.stop()
        assert bytes(first[:1]) == b'a'
        assert next(stream).data == b'b' * size
        with pytest.raises(ValueError, match='released'):
            first.tobytes()


def test_a_message_takes_one_copy_of_the_bytes(kernel, camera, take):
    size = kernel.buffer_size = 1 << 20
    camera.frames.append(take(0, bytes(size)))
    with Device(PATH, kernel) as device, device.stream() as stream:
        frame = next(stream)
        tracemalloc.start()
        try:
            payload = copied(frame.data)
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert isinstance(payload, array.array)  # which a ROS message adopts as it is
    assert len(payload) == size
    assert size <= most < 1.1 * size


def test_a_view_that_is_kept_stays_readable_and_lets_go_when_dropped(kernel, camera, take):
    camera.frames.append(take(0, b'kept'))
    with Device(PATH, kernel) as device, device.stream() as stream:
        view = np.frombuffer(next(stream).data, np.uint8)
    assert view.tobytes() == b'kept'
    assert kernel.leaks['mappings'] == 1
    del view
    for mapping in kernel.mappings:
        mapping.close()


def test_buffers_go_round(kernel, camera, take):
    camera.frames.extend(take(k) for k in range(50))
    with Device(PATH, kernel) as device, device.stream(buffers=2) as stream:
        assert [next(stream).sequence for _ in range(50)] == list(range(50))


def test_a_frozen_camera_is_noticed(kernel):
    with (
        Device(PATH, kernel) as device,
        device.stream(timeout=0.05) as stream,
        pytest.raises(CaptureError, match=r'no frame for 0\.05 s') as caught,
    ):
        next(stream)
    assert caught.value.cause == errors.FROZEN


@pytest.mark.parametrize(
    ('code', 'cause'),
    [
        (errno.ENODEV, errors.GONE),
        (errno.EIO, errors.FAILED),
        (errno.EINVAL, errors.FAILED),
        (errno.EPROTO, errors.FAILED),
    ],
)
def test_trouble_while_streaming_ends_the_stream_with_its_cause(kernel, camera, take, code, cause):
    camera.frames.append(take(0))
    with Device(PATH, kernel) as device, device.stream() as stream:
        next(stream)
        camera.errors[v4l2.VIDIOC_DQBUF] = code
        with pytest.raises(CaptureError) as caught:
            next(stream)
    assert caught.value.cause == cause


def test_a_buffer_that_is_not_taken_back_ends_the_stream(kernel, camera, take):
    camera.frames.extend([take(0), take(1)])
    with Device(PATH, kernel) as device, device.stream() as stream:
        next(stream)
        camera.errors[v4l2.VIDIOC_QBUF] = errno.EINVAL
        with pytest.raises(CaptureError) as caught:
            next(stream)
    assert caught.value.cause == errors.FAILED


def test_a_false_alarm_of_poll_is_waited_over(kernel, camera, take):
    camera.errors[v4l2.VIDIOC_DQBUF] = errno.EAGAIN
    with (
        Device(PATH, kernel) as device,
        device.stream(timeout=0.05) as stream,
        pytest.raises(CaptureError) as caught,
    ):
        next(stream)
    assert caught.value.cause == errors.FROZEN


@pytest.mark.parametrize(
    'request_number', [v4l2.VIDIOC_REQBUFS, v4l2.VIDIOC_QUERYBUF, v4l2.VIDIOC_STREAMON]
)
def test_a_start_that_fails_half_way_leaves_nothing(kernel, camera, request_number):
    camera.errors[request_number] = errno.ENOSPC
    with Device(PATH, kernel) as device:
        with pytest.raises(CaptureError, match='no bandwidth left'):
            device.stream()
        camera.errors.clear()
        with device.stream():
            pass


def test_the_iteration_ends_when_interrupted(kernel, camera, take):
    camera.frames.extend(take(k) for k in range(5))
    seen = []
    with (
        Device(PATH, kernel) as device,
        device.stream(interrupted=lambda: len(seen) == 3) as stream,
    ):
        for frame in stream:
            seen.append(frame.sequence)
    assert seen == [0, 1, 2]


def test_a_closed_stream_has_no_more_frames(kernel, camera, take):
    camera.frames.extend(take(k) for k in range(5))
    with Device(PATH, kernel) as device:
        stream = device.stream()
        next(stream)
        stream.close()
        stream.close()
        assert list(stream) == []


def test_a_driver_that_gives_all_buffers_back_empty_has_failed(kernel, camera, take):
    """uvcvideo does so where the endpoint is halted; nothing comes after that."""
    damaged, empty = (take(0, data, flags=v4l2.BUF_FLAG_ERROR) for data in (b'??', b''))
    with Device(PATH, kernel) as device, device.stream(buffers=3) as stream:
        camera.frames.extend([empty, empty, damaged, empty, empty, take(1)])
        assert [frame.corrupt for frame in islice(stream, 6)] == [True] * 5 + [False]
        camera.frames.extend([empty] * 3)
        with pytest.raises(CaptureError, match='gave all buffers back empty') as caught:
            list(stream)
        assert caught.value.cause == errors.FAILED
