"""Bags as other people's rigs record them, by the verb: every pair of them is used."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import malice
from binopos_ros.bag import BagReader
from binopos_ros.bag.definitions import jazzy
from other_bags import INFO, JPEG, LEFT, PAIRS, RIGHT, Change, Entry, raw, rewritten
from verbs import binopos_here, figure, process, refused, used

pytestmark = pytest.mark.xdist_group('other_bags')

STRING = 'std_msgs/msg/String'


def test_raw_beside_compressed_is_one_stream(demo_bag: Path, tmp_path: Path) -> None:
    def double(entry: Entry) -> list[Entry]:
        if entry.topic.endswith(JPEG):
            return [entry, raw(entry)._replace(topic=entry.topic.removesuffix('/compressed'))]
        return [entry]

    done = process(rewritten(demo_bag, tmp_path / 'bag', double))
    assert figure(done, 'pairs seen') == figure(done, 'pairs used') == str(PAIRS)
    assert figure(done, 'dropped') == '0'


def test_a_bag_in_sqlite_gives_what_the_same_in_mcap_gives(demo_bag: Path, tmp_path: Path) -> None:
    folder = tmp_path / 'old'
    folder.mkdir()
    with BagReader(demo_bag) as reader:
        topics = {topic: info.type for topic, info in reader.topics.items()}
        rows = [(each.topic, each.stamp_ns, each.data) for each in reader.messages()]
    malice.sqlite_bag(folder / 'old_0.db3', topics, rows)
    (folder / 'binopos.yaml').write_text((demo_bag / 'binopos.yaml').read_text())
    tables = [tmp_path / name for name in ('one.csv', 'two.csv')]
    for source, table in zip((demo_bag, folder), tables, strict=True):
        done = binopos_here('process', source, '-o', table.with_suffix('.mcap'), '--csv', table)
        assert used(done) == PAIRS
    assert tables[0].read_bytes() == tables[1].read_bytes()


TURNS = 19
MANY = PAIRS * TURNS


def late(topics: str, nanoseconds: int) -> Change:
    def delay(entry: Entry) -> Entry:
        late = topics in entry.topic
        return entry._replace(log_ns=entry.log_ns + nanoseconds) if late else entry

    return delay


@pytest.mark.parametrize(
    ('topics', 'seconds'),
    [('camera_info', 4.0), ('camera_info', 60.0), ('/right/image_raw', 2.5), ('/left/', 30.0)],
)
def test_what_was_logged_late_is_used_all_the_same(
    demo_bag: Path, tmp_path: Path, topics: str, seconds: float
) -> None:
    change = late(topics, int(seconds * 1e9))
    done = process(rewritten(demo_bag, tmp_path / 'bag', change, repeat=TURNS))
    assert figure(done, 'pairs seen') == figure(done, 'pairs used') == str(MANY)


def test_a_calibration_that_comes_after_an_empty_one_is_used(
    demo_bag: Path, tmp_path: Path
) -> None:
    seen = iter(range(10_000))

    def forget(entry: Entry) -> Entry:
        if entry.topic == f'{RIGHT}/{INFO}' and next(seen) < PAIRS // 2:
            return entry._replace(message=dataclasses.replace(entry.message, k=np.zeros(9)))
        return entry

    done = process(rewritten(demo_bag, tmp_path / 'bag', forget))
    assert used(done) == PAIRS
    assert 'camera_info of the right camera is left out' in done.stdout


def test_both_cameras_that_start_again_keep_their_pairs_however_late_one_is_logged(
    demo_bag: Path, tmp_path: Path
) -> None:
    counts: dict[str, int] = {}

    def jump(entry: Entry) -> Entry:
        count = counts[entry.topic] = counts.get(entry.topic, -1) + 1
        if count >= MANY // 2:
            entry.message.header.stamp.sec -= 3600
        return late('/right/', 1_500_000_000)(entry)

    done = process(rewritten(demo_bag, tmp_path / 'bag', jump, repeat=TURNS))
    assert used(done) >= MANY - 2


def test_calibration_files_beside_a_bag_without_camera_info_are_used(
    demo_bag: Path, tmp_path: Path
) -> None:
    copy = rewritten(demo_bag, tmp_path / 'bag', lambda e: None if e.topic.endswith(INFO) else e)
    refused(process(copy), f'{LEFT}/{INFO} is missing', '--calibration DIR')
    assert used(process(copy, '--calibration', demo_bag)) == PAIRS
    for side in ('left', 'right'):
        (copy / f'{side}.yaml').write_text((demo_bag / f'{side}.yaml').read_text())
    done = process(copy)
    assert used(done) == PAIRS
    assert 'calibration: ' in figure(done, 'note')


@pytest.mark.parametrize(
    ('topic', 'says'),
    [
        (f'{LEFT}/{JPEG}', f'{JPEG} holds {STRING}'),
        (f'{LEFT}/{INFO}', f'it holds {STRING}'),
    ],
)
def test_a_topic_of_the_wrong_type_is_named(
    demo_bag: Path, tmp_path: Path, topic: str, says: str
) -> None:
    refused(process(rewritten(demo_bag, tmp_path / 'bag', as_string(topic))), topic, says)


def test_a_truth_of_the_wrong_type_is_left_out(demo_bag: Path, tmp_path: Path) -> None:
    done = process(rewritten(demo_bag, tmp_path / 'bag', as_string('/stereo/truth/pose')))
    assert used(done) == PAIRS
    assert f'/stereo/truth/pose holds {STRING}' in done.stdout


def as_string(topic: str) -> Change:
    def change(entry: Entry) -> Entry:
        if entry.topic != topic:
            return entry
        return entry._replace(message=jazzy().types[STRING](data='what?'), type=STRING)

    return change


def test_stamps_that_are_zero_and_frames_without_a_name_are_told(
    demo_bag: Path, tmp_path: Path
) -> None:
    def forget(entry: Entry) -> Entry:
        if entry.topic.startswith(LEFT):
            entry.message.header.stamp.sec = entry.message.header.stamp.nanosec = 0
            entry.message.header.frame_id = ''
        return entry

    done = process(rewritten(demo_bag, tmp_path / 'bag', forget))
    assert done.returncode == 1
    assert "left: the stamp is zero: the camera's driver sets none" in done.stdout
    assert f'{LEFT}/{JPEG}: frame_id is empty' in done.stdout
