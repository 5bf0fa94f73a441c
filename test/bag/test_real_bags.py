"""Every file of rosbag2's own test resources: read, or refused, as their SOURCE.md says."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader

from binopos_ros.bag import BagError, BagReader

RESOURCES = 'rosbag2-mcap'
PY = 'rosbag2_py/test/resources/mcap'
TESTS = 'rosbag2_tests/resources/mcap'
TRANSPORT = 'rosbag2_transport/test/resources/mcap'
CPP = 'rosbag2_cpp/test/rosbag2_cpp/bags'

WHOLE = {
    f'{PY}/talker': 20,
    f'{PY}/convert_a': 150,
    f'{PY}/convert_b': 75,
    f'{PY}/wbag': 6074,
    f'{PY}/reindex_test_bags/multiple_files': 3177,
    f'{TRANSPORT}/rewriter_a': 150,
    f'{TRANSPORT}/rewriter_b': 75,
    f'{TRANSPORT}/test_bag_for_seek': 5,
    f'{TESTS}/cdr_test': 7,
    f'{CPP}/only_topics.mcap': 7,
}


@pytest.fixture
def resources(shared_data: Path) -> Path:
    return shared_data / RESOURCES


@pytest.mark.parametrize(('bag', 'count'), WHOLE.items())
def test_reads_and_decodes_every_message_in_the_order_of_time(
    resources: Path, bag: str, count: int
) -> None:
    with BagReader(resources / bag) as reader:
        records = list(reader.messages())
        decoded = [reader.decode(record) for record in records]
    stamps = [record.stamp_ns for record in records]
    assert len(decoded) == reader.message_count == count
    assert stamps == sorted(stamps)
    assert (stamps[0], stamps[-1]) == (reader.start_ns, reader.end_ns)
    assert sum(topic.count for topic in reader.topics.values()) == count
    assert reader.warnings == []


@pytest.mark.parametrize('bag', [*WHOLE, f'{TESTS}/wrong_rmw_test'])
def test_finds_the_bytes_that_the_mcap_library_finds(resources: Path, bag: str) -> None:
    path = resources / bag
    files = sorted(path.glob('*.mcap')) if path.is_dir() else [path]
    expected = []
    for file in files:
        with file.open('rb') as stream:
            expected += [
                (message.log_time, channel.topic, message.data)
                for _, channel, message in make_reader(stream).iter_messages()
            ]
    with BagReader(path) as reader:
        found = [(record.stamp_ns, record.topic, record.data) for record in reader.messages()]
    assert sorted(found) == sorted(expected)


def test_a_split_bag_is_one_bag_whose_topics_add_up(resources: Path) -> None:
    with BagReader(resources / PY / 'wbag') as reader:
        counts = {name: topic.count for name, topic in reader.topics.items()}
    assert counts == {
        'AAA': 804, 'BBB': 742, 'CCC': 742, 'DDD': 753,
        'EEE': 804, 'FFF': 772, 'GGG': 731, 'HHH': 726,
    }  # fmt: skip


def test_reads_fields_as_they_were_published(resources: Path) -> None:
    with BagReader(resources / PY / 'talker') as reader:
        texts = [reader.decode(record).data for record in reader.messages(['/topic'])]
    assert texts == [f'Hello, world! {number}' for number in range(10)]


def test_short_type_names_of_old_bags_are_understood(resources: Path) -> None:
    with BagReader(resources / TRANSPORT / 'test_bag_for_seek') as reader:
        assert reader.topics['topic1'].type == 'test_msgs/msg/BasicTypes'
        values = [reader.decode(record).int32_value for record in reader.messages()]
    assert len(values) == 5


@pytest.mark.parametrize(
    'bag', [f'{TESTS}/bag_with_topics_and_service_events', f'{CPP}/topics_and_services.mcap']
)
def test_service_events_do_not_keep_topics_from_being_read(resources: Path, bag: str) -> None:
    with BagReader(resources / bag) as reader:
        plain = [topic for topic in reader.topics if not topic.endswith('/_service_event')]
        decoded = [reader.decode(record) for record in reader.messages(plain)]
    assert decoded
    assert len(decoded) == sum(reader.topics[topic].count for topic in plain)


def test_a_service_event_is_refused_in_one_line(resources: Path) -> None:
    with BagReader(resources / CPP / 'only_services.mcap') as reader:
        record = next(reader.messages())
        with pytest.raises(BagError, match=r'add_two_ints/_service_event.*cannot be parsed') as it:
            reader.decode(record)
    assert '\n' not in str(it.value)


def test_an_unknown_encoding_is_named(resources: Path) -> None:
    with BagReader(resources / TESTS / 'wrong_rmw_test') as reader:
        record = next(reader.messages(['/test_topic']))
        with pytest.raises(BagError, match="topic /test_topic is encoded as 'wrong_format'"):
            reader.decode(record)


def test_recorded_quality_of_service_is_read_in_both_spellings(resources: Path) -> None:
    with BagReader(resources / PY / 'talker') as reader:
        (rosout,) = reader.topics['/rosout'].qos
    assert (rosout.durability, rosout.reliability) == ('transient_local', 'reliable')
    assert rosout.lifespan_ns == 10 * 10**9


def test_every_real_file_is_read_to_its_last_message(shared_data: Path) -> None:
    files = sorted([*shared_data.rglob('*.mcap'), *(shared_data.parent / 'cases').rglob('*.mcap')])
    assert len(files) >= 20
    for file in files:
        with file.open('rb') as stream:
            expected = sum(1 for _ in make_reader(stream).iter_messages())
        with BagReader(file) as reader:
            assert sum(1 for _ in reader.messages()) == expected, file
            assert reader.warnings == [], file
