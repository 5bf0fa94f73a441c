"""Everything that happens to cameras on a robot, to cameras in a fake kernel."""

from __future__ import annotations

import errno
import gc
import threading
import tracemalloc
from dataclasses import replace

import pytest

from binopos_ros.capture import errors, recovery
from binopos_ros.capture import kernel as v4l2
from binopos_ros.capture.errors import CaptureError
from binopos_ros.capture.identity import Identity
from binopos_ros.capture.options import Wanted
from binopos_ros.capture.recovery import Pauses, SteadyCamera
from binopos_ros.capture.usb import Camera

LEFT = Camera('/dev/video0', 'Lab', 0, '1209:0001', 'S1', '3-1', bus=3, address=5)
RIGHT = Camera('/dev/video2', 'Lab', 0, '1209:0001', 'S2', '3-2', bus=3, address=6)
WANTED = Wanted('MJPG', 640, 480, 30.0, frame_timeout=0.05)
PATIENCE = 20.0


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch):
    monkeypatch.setattr(recovery, 'FIRST_PAUSE', 0.001)
    monkeypatch.setattr(recovery, 'LONGEST_PAUSE', 0.01)


class Bench:
    """A USB bus with a camera that streams by itself, and a steady camera reading from it."""

    def __init__(self, kernel, camera):
        camera.live = 2000.0
        self.kernel, self.fake, self.plugged = kernel, camera, {LEFT: camera}
        self.resets = []
        self.seen = threading.Condition()
        self.frames = 0
        self.thread = None

    def camera(self, name='S1', wanted=WANTED, **options):
        return SteadyCamera(
            name,
            wanted,
            kernel=self.kernel,
            look=lambda: list(self.plugged),
            reset=self.resets.append,
            **options,
        )

    def unplug(self):
        self.fake.gone = True
        self.plugged.clear()

    def plug(self, where=LEFT):
        self.fake.gone = self.fake.streaming = False
        self.fake.__dict__['memory'] = {}
        self.kernel.cameras = {where.node: self.fake}
        self.plugged[where] = self.fake

    def run(self, steady):
        def work():
            for frame in steady.frames():
                assert bytes(frame.data) == self.fake.picture
                with self.seen:
                    self.frames += 1
                    self.seen.notify_all()

        self.thread = threading.Thread(target=work)
        self.thread.start()
        self.steady = steady
        return steady

    def wait_for_frames(self, count=3):
        with self.seen:
            goal = self.frames + count
            assert self.seen.wait_for(lambda: self.frames >= goal, PATIENCE), self.steady.health

    def wait_until(self, condition):
        for _ in range(int(PATIENCE / 0.002)):
            if condition():
                return
            threading.Event().wait(0.002)
        raise AssertionError(self.steady.health)

    def wait_for_trouble(self, words):
        self.wait_until(lambda: words in self.steady.health.trouble)

    def end(self):
        if self.thread is not None:
            self.steady.stop()
            self.thread.join(PATIENCE)
            assert not self.thread.is_alive()


@pytest.fixture
def bench(kernel, camera):
    bench = Bench(kernel, camera)
    yield bench
    bench.end()


def test_it_streams_until_stopped(bench):
    steady = bench.run(bench.camera())
    bench.wait_for_frames(20)
    assert steady.health.state == recovery.STREAMING
    assert steady.health.trouble == ''
    assert steady.health.format.pixel_format == 'MJPG'
    bench.end()
    assert steady.health.state == recovery.CLOSED


def test_it_streams_again_after_a_stop(bench):
    steady = bench.run(bench.camera())
    bench.wait_for_frames()
    bench.end()
    assert list(steady.frames()) == []
    steady.resume()
    bench.run(steady)
    bench.wait_for_frames()


def test_a_camera_missing_at_the_start_is_waited_for(bench):
    bench.unplug()
    steady = bench.run(bench.camera())
    bench.wait_for_trouble("camera 'S1' is not plugged in; there are: none")
    assert steady.health.state == recovery.WAITING
    bench.plug()
    bench.wait_for_frames()
    assert steady.health.losses == {}


def test_an_unplugged_camera_comes_back_on_another_port(bench):
    steady = bench.run(bench.camera())
    bench.wait_for_frames()
    bench.unplug()
    bench.wait_for_trouble('is unplugged; plug it in again')
    assert steady.health.state == recovery.LOST
    bench.plug(replace(LEFT, node='/dev/video5', port='1-4'))
    bench.wait_for_frames()
    assert steady.health.state == recovery.STREAMING
    assert steady.health.notice == 'moved from USB port 3-1 to 1-4'
    assert steady.health.losses == {errors.GONE: 1}
    assert steady.health.outage >= steady.health.recovery > 0.0


def test_another_camera_in_its_place_is_not_taken_for_it(bench):
    bench.run(bench.camera())
    bench.wait_for_frames()
    bench.unplug()
    bench.plug(replace(RIGHT, port='3-1'))
    bench.wait_for_trouble('where there is /dev/video2 (Lab, serial S2, 1209:0001 at port 3-1)')
    assert 'exchanged?' in bench.steady.health.trouble


@pytest.mark.parametrize(
    ('code', 'cause'),
    [(errno.EIO, errors.FAILED), (errno.EINVAL, errors.FAILED), (errno.ENODEV, errors.GONE)],
)
def test_a_stream_that_breaks_is_started_again(bench, code, cause):
    steady = bench.run(bench.camera())
    bench.wait_for_frames()
    bench.fake.errors[v4l2.VIDIOC_DQBUF] = code
    bench.wait_until(lambda: steady.health.losses[cause] == 1)
    bench.fake.errors.clear()
    bench.wait_for_frames()
    assert bench.fake.streams_started >= 2


def test_a_frozen_camera_is_opened_again(bench):
    steady = bench.run(bench.camera())
    bench.wait_for_frames()
    bench.fake.live = 0.0
    bench.wait_for_trouble('no frame for 0.05 s')
    bench.fake.live = 2000.0
    bench.wait_for_frames()
    assert steady.health.losses[errors.FROZEN] == 1
    assert bench.resets == []


def test_a_camera_that_stays_frozen_is_reset_where_that_is_allowed(bench):
    bench.fake.live = 0.0
    steady = bench.run(bench.camera(wanted=replace(WANTED, usb_reset=True)))
    bench.wait_until(lambda: steady.health.resets >= 1)
    assert bench.resets[0] == LEFT


def test_a_reset_that_is_refused_is_told(bench):
    def refuse(camera):
        raise CaptureError('no rights to reset it', errors.DENIED)

    bench.fake.live = 0.0
    steady = bench.camera(wanted=replace(WANTED, usb_reset=True))
    steady._reset = refuse
    bench.run(steady)
    bench.wait_for_trouble('no rights to reset it')


@pytest.mark.parametrize(
    ('code', 'words'), [(errno.EBUSY, 'another program uses it'), (errno.EACCES, 'udev rule')]
)
def test_a_camera_that_is_refused_is_tried_again(bench, code, words):
    bench.fake.open_error = code
    bench.run(bench.camera())
    bench.wait_for_trouble(words)
    bench.fake.open_error = 0
    bench.wait_for_frames()


def test_damaged_and_empty_frames_are_dropped_and_counted(bench, take):
    bench.fake.live = 0.0
    bench.fake.frames.extend(
        [
            take(0, bench.fake.picture),
            take(1, bench.fake.picture, flags=v4l2.BUF_FLAG_ERROR),
            take(2, b''),
            take(5, bench.fake.picture),
        ]
    )
    steady = bench.run(bench.camera())
    bench.wait_until(lambda: bench.frames == 2)
    assert (steady.health.good, steady.health.corrupt, steady.health.lost) == (2, 2, 2)


def test_a_camera_that_sends_only_damage_is_opened_again(bench, take):
    bench.fake.live = 0.0
    stop = threading.Event()

    def damage():
        sequence = 0
        while not stop.wait(0.002):
            sequence += 1
            bench.fake.frames.append(take(sequence, b'??', flags=v4l2.BUF_FLAG_ERROR))

    source = threading.Thread(target=damage)
    source.start()
    try:
        bench.run(bench.camera())
        bench.wait_for_trouble('only damaged frames for 0.05 s')
    finally:
        stop.set()
        source.join()


def test_the_camera_of_the_other_side_is_refused(bench):
    steady = bench.camera(others=lambda: [Identity.of(LEFT)])
    with pytest.raises(CaptureError, match='which the other side has') as caught:
        steady.check()
    assert caught.value.cause == errors.INVALID


@pytest.mark.parametrize(
    ('wanted', 'controls', 'words'),
    [
        (replace(WANTED, width=650), {}, 'no MJPG 650x480; it offers MJPG 640x480'),
        (WANTED, {'gain': 96}, 'gain = 96 is out of range'),
        (WANTED, {'zoom': 1}, "no control 'zoom'"),
    ],
)
def test_what_cannot_mend_itself_is_known_at_the_start(bench, wanted, controls, words):
    with pytest.raises(CaptureError, match=words) as caught:
        bench.camera(wanted=wanted, controls=controls).check()
    assert caught.value.cause == errors.INVALID


def test_controls_are_set_again_each_time_it_is_opened(bench):
    exposure = next(one for one in bench.fake.controls if one.label.startswith('Exposure'))
    gain = next(one for one in bench.fake.controls if one.label == 'Gain')
    exposure.flags = 0
    steady = bench.camera(controls={'exposure_time_absolute': 77, 'auto_exposure': 1})
    bench.run(steady)
    bench.wait_for_frames()
    assert exposure.value == 77
    steady.set_control('gain', 40)
    assert (gain.value, steady.get_control('gain')) == (40, 40)
    with pytest.raises(CaptureError, match='out of range'):
        steady.set_control('gain', 96)
    steady.leave_control('exposure_time_absolute')
    bench.unplug()
    bench.wait_for_trouble('unplugged')
    assert steady.get_control('gain') is None
    steady.set_control('gain', 45)
    exposure.value = gain.value = 5
    bench.plug()
    bench.wait_for_frames()
    assert (gain.value, exposure.value) == (45, 5)


def test_two_hundred_unplugs_leave_nothing_behind(bench):
    steady = bench.run(bench.camera())
    ports = [LEFT, replace(LEFT, node='/dev/video5', port='1-4')]
    threads = threading.active_count()

    def cycle(count):
        for k in range(count):
            bench.wait_for_frames(1)
            bench.unplug()
            losses = steady.health.losses.total()
            bench.wait_until(lambda before=losses: steady.health.state != recovery.STREAMING)
            bench.plug(ports[k % 2])
        bench.wait_for_frames(1)
        bench.kernel.requests.clear()
        gc.collect()

    cycle(20)
    tracemalloc.start()
    try:
        cycle(20)
        before = tracemalloc.get_traced_memory()[0]
        cycle(160)
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert threading.active_count() == threads
    assert len(bench.kernel.descriptors) == 1
    assert bench.kernel.leaks['mappings'] == 4
    assert grown < 160 * 64  # less than an object a cycle


def test_pauses_grow_and_begin_small_again_after_a_steady_stream(monkeypatch):
    monkeypatch.undo()
    pauses = Pauses()
    waited = [pauses.after(errors.BUSY, 0.0) for _ in range(8)]
    assert waited == sorted(waited)
    assert waited[0] < waited[3] < waited[-1] == recovery.LONGEST_PAUSE
    for cause in (errors.GONE, errors.FROZEN):
        assert pauses.after(cause, 0.0) == recovery.LONGEST_SHORT_PAUSE
    assert pauses.after(errors.BUSY, recovery.STEADY + 1.0) == waited[0]
