"""Recording: killed, on a full disk, and in the ordinary way."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.reader import NonSeekingReader, make_reader
from rosbags.rosbag2 import Reader as RosbagsReader

from binopos_ros.bag import BagError, BagReader
from binopos_ros.bag.qos import Qos
from binopos_ros.bag.recording import RecorderOptions, Recording

STRING = 'std_msgs/msg/String'

# Writes the time at which each message was recorded into it, and says when it has begun.
RECORD_FOR_EVER = """
import sys, time
from binopos_ros.bag.recording import RecorderOptions, Recording
recording = Recording(RecorderOptions(bag=sys.argv[1], compression=sys.argv[2]))
recording.add_topic('/a', 'std_msgs/msg/String')
print('recording', flush=True)
while True:
    now = time.time_ns()
    recording.write('/a', now, now.to_bytes(8, 'little') * 2000)
    time.sleep(0.004)
"""


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_a_killed_recorder_leaves_all_but_the_last_second(
    tmp_path: Path, project: Path, compression: str
) -> None:
    path = tmp_path / 'bag'
    process = subprocess.Popen(
        [sys.executable, '-c', RECORD_FOR_EVER, str(path), compression],
        cwd=project,
        stdout=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(2.2)
    process.send_signal(signal.SIGKILL)
    killed = time.time_ns()
    process.wait()
    with BagReader(path) as reader:
        records = list(reader.messages())
        assert reader.warnings == []
        assert reader.message_count == len(records)
    assert all(record.data[:8] == record.stamp_ns.to_bytes(8, 'little') for record in records)
    assert killed - records[-1].stamp_ns < 10**9
    assert records[-1].stamp_ns - records[0].stamp_ns > 10**9
    with (path / 'bag_0.mcap').open('rb') as stream:
        seeking = [message.log_time for _, _, message in make_reader(stream).iter_messages()]
        stream.seek(0)
        streaming = [m.log_time for _, _, m in NonSeekingReader(stream).iter_messages()]
    assert seeking == streaming == [record.stamp_ns for record in records]
    with RosbagsReader(path) as rosbag:
        assert sum(1 for _ in rosbag.messages()) == len(records)


def test_a_finished_recording_holds_everything(tmp_path: Path) -> None:
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag'), max_bag_size=50_000))
    recording.add_topic('/a', STRING)
    for number in range(500):
        assert recording.write('/a', number, bytes(400))
    recording.close()
    assert (recording.failure, recording.written, recording.overflow) == ('', 500, 0)
    with BagReader(tmp_path / 'bag') as reader:
        assert [record.stamp_ns for record in reader.messages()] == list(range(500))
    assert len(list((tmp_path / 'bag').glob('*.mcap'))) == 5


def test_a_new_file_begins_after_the_longest_duration(tmp_path: Path) -> None:
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag'), max_bag_duration=2.0))
    recording.add_topic('/a', STRING)
    for number in range(50):
        assert recording.write('/a', number * 10**8, bytes(4))
    recording.close()
    files = sorted((tmp_path / 'bag').glob('*.mcap'))
    spans = []
    for file in files:
        with BagReader(file) as reader:
            spans.append((reader.start_ns / 1e9, reader.end_ns / 1e9))
    assert spans == [(0.0, 1.9), (2.0, 3.9), (4.0, 4.9)]


def test_a_flood_of_messages_does_not_hold_up_the_flush(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('binopos_ros.bag.recording.FLUSH_PERIOD', 0.01)
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag')))
    recording.add_topic('/a', STRING)
    flushed = 0
    for number in range(300_000):
        recording.write('/a', number, b'')
        if number % 10_000 == 9_999:
            with BagReader(tmp_path / 'bag') as reader:
                flushed = reader.message_count
            if flushed:
                break
    recording.close()
    # No chunk was full by then: it was the time that flushed.
    assert 0 < flushed < 300_000


def test_a_full_disk_ends_the_recording_with_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.pwritev

    def limited(descriptor: int, parts: list[memoryview], offset: int) -> int:
        if offset + sum(map(len, parts)) > 100_000:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(descriptor, parts, offset)

    monkeypatch.setattr(os, 'pwritev', limited)
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag'), min_free_space=0))
    recording.add_topic('/a', STRING)
    number = 0
    deadline = time.monotonic() + 20
    while not recording.failure and time.monotonic() < deadline:
        recording.write('/a', number, bytes(1000))
        number += 1
        time.sleep(0.01)
    assert 'no space left' in recording.failure
    assert '\n' not in recording.failure
    assert not recording.write('/a', number, b'')
    recording.close()
    with BagReader(tmp_path / 'bag') as reader:
        stamps = [record.stamp_ns for record in reader.messages()]
        assert reader.warnings == []
    assert stamps == list(range(len(stamps)))
    assert len(stamps) > 20


def test_a_disk_that_stalls_costs_messages_but_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('binopos_ros.bag.recording.QUEUE_BYTES', 10_000)
    stalled, released = [], []
    write = os.pwritev

    def stall(descriptor: int, parts: list[memoryview], offset: int) -> int:
        if sum(map(len, parts)) > 5000:
            stalled.append(True)
            while not released:
                time.sleep(0.001)
        return write(descriptor, parts, offset)

    monkeypatch.setattr(os, 'pwritev', stall)
    monkeypatch.setattr('binopos_ros.bag.recording.FLUSH_PERIOD', 0.01)
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag')))
    recording.add_topic('/a', STRING)
    taken = [recording.write('/a', 0, bytes(6000))]
    while not stalled:
        time.sleep(0.001)
    taken += [recording.write('/a', number, bytes(1000)) for number in range(1, 20)]
    released.append(True)
    recording.close()
    assert taken == [True] * 11 + [False] * 9
    assert recording.overflow == 9
    with BagReader(tmp_path / 'bag') as reader:
        assert reader.message_count == 11


def test_contradicting_options_are_refused() -> None:
    with pytest.raises(BagError, match='all excludes'):
        RecorderOptions(bag='bag', all=True, topics=('/a',))


SECOND = 10**9


def recorded(bag: Path) -> list[tuple[str, int]]:
    with BagReader(bag) as reader:
        assert reader.warnings == []
        return [(record.topic, record.stamp_ns) for record in reader.messages()]


def made(bag: Path, **options: object) -> Recording:
    """A recording of a stream, and of a calibration that came before it began."""
    recording = Recording(RecorderOptions(bag=str(bag), **options))  # type: ignore[arg-type]
    recording.add_topic('/a', STRING)
    recording.add_topic('/camera_info', 'sensor_msgs/msg/CameraInfo')
    recording.add_topic('/latched', STRING, (Qos(durability='transient_local'),))
    recording.write('/camera_info', 0, b'calibration')
    return recording


def test_a_pause_leaves_a_gap_and_the_calibration_is_there_after_it(tmp_path: Path) -> None:
    recording = made(tmp_path / 'bag', start_paused=True)
    recording.write('/a', 1, b'')
    recording.resume(10)
    recording.write('/a', 11, b'')
    recording.pause()
    recording.write('/a', 12, b'')
    recording.write('/latched', 13, b'')
    recording.resume(20)
    recording.resume(21)
    recording.write('/a', 22, b'')
    recording.close()
    assert recorded(tmp_path / 'bag') == [
        ('/camera_info', 10), ('/a', 11), ('/camera_info', 20), ('/latched', 20), ('/a', 22),
    ]  # fmt: skip


def test_a_snapshot_is_the_last_seconds_with_the_calibration(tmp_path: Path) -> None:
    recording = made(tmp_path / 'bag', snapshot=2.0)
    for number in range(100):
        recording.write('/a', SECOND + number * SECOND // 10, bytes(100))
    assert recording.take_snapshot() == 22
    assert recording.take_snapshot() == 0
    recording.write('/a', 20 * SECOND, b'')
    recording.close()
    first = SECOND + 79 * SECOND // 10
    stamps = [first + number * SECOND // 10 for number in range(21)]
    assert recorded(tmp_path / 'bag') == [
        ('/camera_info', first), *(('/a', stamp) for stamp in stamps),
    ]  # fmt: skip


def test_a_snapshot_takes_no_more_memory_than_it_may(tmp_path: Path) -> None:
    recording = made(tmp_path / 'bag', snapshot=3600.0, snapshot_size=1000)
    for number in range(100):
        recording.write('/a', number, bytes(100))
    recording.take_snapshot()
    recording.close()
    assert [stamp for topic, stamp in recorded(tmp_path / 'bag') if topic == '/a'] == list(
        range(90, 100)
    )


def test_without_snapshots_none_is_taken(tmp_path: Path) -> None:
    recording = made(tmp_path / 'bag')
    with pytest.raises(BagError, match='set snapshot'):
        recording.take_snapshot()
    recording.close()


def test_a_split_begins_a_new_file(tmp_path: Path) -> None:
    recording = made(tmp_path / 'bag')
    for number in range(3):
        recording.write('/a', 10 + number, b'')
        recording.split()
    recording.split()
    recording.close()
    files = sorted((tmp_path / 'bag').glob('*.mcap'))
    counts = [make_reader(file.open('rb')).get_summary().statistics for file in files]
    assert [each.message_count for each in counts] == [2, 1, 1, 0]
    assert len(recorded(tmp_path / 'bag')) == 4
    single = made(tmp_path / 'bag.mcap')
    with pytest.raises(BagError, match='cannot be split'):
        single.split()
    single.close()


def test_recording_ends_while_there_is_room_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = [10 << 20]
    monkeypatch.setattr(
        'binopos_ros.bag.recording.shutil.disk_usage', lambda _: SimpleNamespace(free=free[0])
    )
    monkeypatch.setattr('binopos_ros.bag.recording.FLUSH_PERIOD', 0.01)
    recording = made(tmp_path / 'bag', min_free_space=5 << 20)
    deadline = time.monotonic() + 20
    while not recording.written and time.monotonic() < deadline:
        time.sleep(0.01)
    assert recording.failure == ''
    free[0] = 4 << 20
    while not recording.failure and time.monotonic() < deadline:
        time.sleep(0.01)
    assert '4 MiB are left on its disk, less than the 5 MiB' in recording.failure
    recording.close()
    assert len(recorded(tmp_path / 'bag')) == 1


@pytest.mark.parametrize(
    ('options', 'topic', 'wanted'),
    [
        ({}, '/named', True),
        ({}, '/other', False),
        ({'all': True}, '/other', True),
        ({'all': True, 'exclude_regex': 'image_raw$'}, '/stereo/left/image_raw', False),
        ({'all': True, 'exclude_regex': 'image_raw$'}, '/stereo/left/image_raw/compressed', True),
        ({'regex': '/target/'}, '/stereo/target/pose', True),
        ({'regex': '^/target/'}, '/stereo/target/pose', False),
        ({'regex': 'o', 'exclude_regex': 'pose'}, '/stereo/target/pose', False),
        ({'exclude_regex': 'named'}, '/named', False),
    ],
)
def test_topics_are_chosen_by_expressions(
    options: dict[str, object], topic: str, wanted: bool
) -> None:
    chosen = RecorderOptions(bag='bag', **options)  # type: ignore[arg-type]
    assert chosen.wants(topic, {'/named'}) is wanted


@pytest.mark.parametrize('name', ['regex', 'exclude_regex'])
def test_an_expression_that_is_none_is_refused(name: str) -> None:
    with pytest.raises(BagError, match=rf'{name} .* is no regular expression'):
        RecorderOptions(bag='bag', **{name: '*'})  # type: ignore[arg-type]
