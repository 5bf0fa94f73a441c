"""Recording: killed, on a full disk, and in the ordinary way."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader, make_reader
from rosbags.rosbag2 import Reader as RosbagsReader

from binopos_ros.bag import BagError, BagReader
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
    recording = Recording(RecorderOptions(bag=str(tmp_path / 'bag')))
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
    with pytest.raises(BagError, match='exclude each other'):
        RecorderOptions(bag='bag', all=True, topics=('/a',))
