"""Bad bags and bad parameters: one clear line, and nothing that is good is lost."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from binopos_ros.bag import BagReader, BagWriter
from other_bags import PAIRS
from verbs import binopos, process, refused, used

pytestmark = pytest.mark.xdist_group('bad_input')

Change = Callable[[str, int, Any], Any]


@pytest.fixture
def rewritten(demo_bag: Path, tmp_path: Path) -> Callable[[Change], Path]:
    """A copy of the good bag: change(topic, count so far, message) gives the message or None."""

    def rewrite(change: Change) -> Path:
        copy = tmp_path / 'changed'
        counts: dict[str, int] = {}
        with BagReader(demo_bag) as reader, BagWriter(copy) as writer:
            for topic, info in reader.topics.items():
                writer.add_topic(topic, info.type)
            for record in reader.messages():
                count = counts[record.topic] = counts.get(record.topic, -1) + 1
                message = change(record.topic, count, reader.decode(record))
                if message is not None:
                    writer.write(record.topic, record.stamp_ns, message)
        (copy / 'binopos.yaml').write_text((demo_bag / 'binopos.yaml').read_text())
        return copy

    return rewrite


def test_the_good_bag_is_used_in_full(demo_bag, tmp_path):
    done = binopos('process', demo_bag, '-o', tmp_path / 'out.mcap')
    assert used(done) == PAIRS


def test_a_bag_that_does_not_exist(tmp_path):
    refused(process(tmp_path / 'nowhere'), 'nowhere')


def test_an_empty_file(tmp_path):
    (tmp_path / 'empty.mcap').touch()
    refused(process(tmp_path / 'empty.mcap'), 'empty.mcap')


def test_a_file_that_is_no_bag(tmp_path):
    (tmp_path / 'notes.mcap').write_text('remember the milk\n' * 100)
    refused(process(tmp_path / 'notes.mcap'), 'notes.mcap')


def test_a_bag_that_was_cut_off_is_used_as_far_as_it_goes(demo_bag, tmp_path):
    whole = next(demo_bag.glob('*.mcap')).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: len(whole) * 3 // 4])
    words = ('process', cut, '-o', tmp_path / 'out.mcap', '--config', demo_bag / 'binopos.yaml')
    done = binopos(*words)
    assert 1 <= used(done) < PAIRS
    assert 'cut' in done.stderr


@pytest.mark.parametrize(
    'topic', ['/stereo/right/image_raw/compressed', '/stereo/left/camera_info']
)
def test_a_topic_of_the_rig_that_is_missing(rewritten, topic):
    bag = rewritten(lambda name, _, message: None if name == topic else message)
    refused(process(bag), topic)


def test_an_uncalibrated_camera(rewritten):
    def forget(topic, _, message):
        if topic == '/stereo/right/camera_info':
            return dataclasses.replace(message, k=np.zeros(9))
        return message

    refused(process(rewritten(forget)), 'right', 'uncalibrated')


def test_a_calibration_of_another_size(rewritten):
    def halve(topic, _, message):
        if topic == '/stereo/left/camera_info':
            return dataclasses.replace(message, width=320, height=240)
        return message

    done = process(rewritten(halve))
    assert done.returncode == 1
    assert used(done) == 0
    assert 'but its camera_info is for' in done.stdout


def test_a_calibration_that_holds_nan(rewritten):
    def spoil(topic, _, message):
        if topic == '/stereo/left/camera_info':
            return dataclasses.replace(message, d=np.full(5, np.nan))
        return message

    refused(process(rewritten(spoil)), 'left')


def test_a_corrupt_jpeg_among_good_ones_costs_one_pair(rewritten):
    def spoil(topic, count, message):
        if topic == '/stereo/left/image_raw/compressed' and count == 3:
            return dataclasses.replace(message, data=message.data[: len(message.data) // 2])
        return message

    done = process(rewritten(spoil))
    assert used(done) == PAIRS - 1
    assert 'dropped: left: JPEG' in done.stdout


def test_a_stamp_that_jumps_back_starts_again(rewritten):
    def jump(topic, count, message):
        if count >= PAIRS // 2:
            message.header.stamp.sec -= 3600
        return message

    assert used(process(rewritten(jump))) == PAIRS


def test_a_target_that_leaves_the_view_leaves_no_position(rewritten, tmp_path):
    def blank(topic, count, message):
        if topic.endswith('compressed') and count in (2, 3):
            return dataclasses.replace(message, data=grey_jpeg(message.data))
        return message

    table = tmp_path / 'all.csv'
    done = process(rewritten(blank), '--csv', table, '--csv-all')
    assert used(done) == PAIRS - 2
    assert 'dropped: left: ' in done.stdout
    with table.open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == PAIRS
    assert [row['stamp'] for row in rows] == sorted(row['stamp'] for row in rows)
    for number, row in enumerate(rows):
        empty = [name for name, value in row.items() if not value]
        lost = number in (2, 3)
        assert row['reason'].startswith('left: ') == lost
        assert empty == (list(row)[1:-1] if lost else ['reason'])


def grey_jpeg(data: np.ndarray) -> np.ndarray:
    import cv2

    picture = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return cv2.imencode('.jpg', np.full_like(picture, 128))[1].ravel()


@pytest.mark.parametrize(
    ('assignment', 'words'),
    [
        ('triangulator:interface.distance:=-0.5', 'it must lie in'),
        ('triangulator:interface.distance:=0.0', 'ahead of the camera'),
        ('triangulator:interface.normal:=[0.0, 0.0, -1.0]', 'behind'),
        ('triangulator:interface.indices:=[1.0, 0.5]', 'interface.indices'),
        ('triangulator:interface.distanse:=0.5', "did you mean 'interface.distance'"),
        ('triangulator:interface.distance:=.nan', 'finite'),
        ('triangulator:method:=magic', 'choose one of'),
        ('detector:min_diameter:=1e9', 'min_diameter'),
        ('smoother:sensor_timeout:=-1.0', 'it must lie in'),
        ('smoother:max_jmp:=1.0', 'max_jump'),
    ],
)
def test_a_bad_parameter(demo_bag, tmp_path, assignment, words):
    done = binopos(
        'process', demo_bag, '-o', tmp_path / 'out.mcap', '--ros-args', '-p', assignment
    )
    refused(done, words)


def test_total_reflection_gives_no_position_but_a_reason(demo_bag, tmp_path):
    """From water into air, as in a flooded housing: most rays never leave the water."""
    done = binopos(
        *('process', demo_bag, '-o', tmp_path / 'out.mcap', '--ros-args'),
        *('-p', 'triangulator:interface.indices:=[4.0, 1.0]'),
        *('-p', 'triangulator:interface.normal:=[0.6, 0.0, 0.8]'),
    )
    assert done.returncode == 1
    assert used(done) == 0
    assert 'reflect' in done.stdout


def test_a_config_that_does_not_exist(demo_bag, tmp_path):
    refused(
        binopos('process', demo_bag, '-o', tmp_path / 'o.mcap', '--config', tmp_path / 'no.yaml'),
        'no.yaml',
    )


def test_an_output_that_exists_is_not_overwritten(demo_bag, tmp_path):
    (tmp_path / 'out.mcap').write_bytes(b'precious')
    refused(binopos('process', demo_bag, '-o', tmp_path / 'out.mcap'), 'out.mcap')
    assert (tmp_path / 'out.mcap').read_bytes() == b'precious'
