"""Damaged, cut off and incomplete bags: what is whole is read, what is lost is told."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.stream_reader import StreamReader

from binopos_ros.bag import BagError, BagReader, BagWriter, messages
from stored import read

MakeBag = Callable[..., Path]


def test_a_damaged_chunk_costs_only_itself(
    make_bag: MakeBag, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_bag(tmp_path / 'bag.mcap', chunk_bytes=5000)
    whole = read(path)
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 8] = bytes(8)
    path.write_bytes(data)
    caplog.clear()
    rest = read(path)
    assert 34 <= len(rest) < 40
    assert set(rest) < set(whole)
    (record,) = caplog.records
    assert 'chunk is damaged' in record.getMessage()


@pytest.mark.parametrize('compression', ['none', 'zstd', 'lz4'])
@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(cut=st.floats(0.01, 0.999))
def test_a_truncated_file_is_read_to_its_last_whole_message(
    make_bag: MakeBag, tmp_path: Path, compression: str, cut: float
) -> None:
    path = tmp_path / f'{compression}.mcap'
    if not path.exists():
        make_bag(path, compression=compression, chunk_bytes=7000)
    whole = read(path)
    data = path.read_bytes()
    data = data[: int(cut * len(data))]
    torn = tmp_path / 'torn.mcap'
    torn.write_bytes(data)
    expected = whole_records(data)
    with BagReader(torn) as reader:
        found = [(record.stamp_ns, record.topic, record.data) for record in reader.messages()]
        assert reader.message_count == len(found)
    # The library stops at the last whole chunk; a torn one gives more.
    assert found == whole[: len(found)]
    assert len(found) >= expected
    if compression == 'none':
        assert len(found) == sum(payload in data for _, _, payload in whole)


def whole_records(data: bytes) -> int:
    """Messages that the mcap library's own stream reader gets out of cut-off bytes."""
    count = 0
    try:
        for record in StreamReader(io.BytesIO(data)).records:
            count += type(record).__name__ == 'Message'
    except Exception:
        # It ends in one error or another, wherever it happens to stand.
        pass
    return count


@pytest.mark.parametrize('tail', [bytes(5000), b'\xff' * 5000, b'\x05' * 13])
def test_rubbish_after_the_last_record_is_left_out(
    make_bag: MakeBag, tmp_path: Path, tail: bytes
) -> None:
    # A file system that lost power leaves zeros behind the last block.
    path = make_bag(tmp_path / 'bag.mcap')
    whole = read(path)
    data = path.read_bytes()
    body = data[: data.rindex(b'\x0f' + (4).to_bytes(8, 'little'))]
    path.write_bytes(body + tail)
    with BagReader(path) as reader:
        assert reader.message_count == len(whole)
        (warning,) = reader.warnings
        assert 'bag.mcap' in warning
    assert read(path) == whole


def test_says_how_much_of_a_truncated_file_is_lost(
    make_bag: MakeBag, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_bag(tmp_path / 'bag.mcap', chunk_bytes=5000)
    path.write_bytes(path.read_bytes()[:30000])
    with BagReader(path) as reader:
        count = reader.message_count
    assert [record.levelname for record in caplog.records] == ['WARNING']
    assert f'its first {count} messages are read' in caplog.text
    assert 'bytes before its end' in caplog.text


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(edits=st.lists(st.tuples(st.floats(0, 1), st.binary(min_size=1, max_size=9)), max_size=6))
def test_damaged_bytes_never_end_in_anything_but_a_bag_error(
    make_bag: MakeBag, tmp_path: Path, edits: list[tuple[float, bytes]]
) -> None:
    path = tmp_path / 'whole.mcap'
    if not path.exists():
        make_bag(path, pairs=6, size=60, chunk_bytes=400)
    data = bytearray(path.read_bytes())
    for place, replacement in edits:
        start = int(place * len(data))
        data[start : start + len(replacement)] = replacement
    damaged = tmp_path / 'damaged.mcap'
    damaged.write_bytes(data)
    refusal = ''
    try:
        with BagReader(damaged) as reader:
            for record in reader.messages():
                reader.decode(record)
    except BagError as error:
        refusal = str(error)
    assert '\n' not in refusal


@pytest.mark.parametrize('text', ['', 'rosbag2_bagfile_information: 7', '{', 'a: b', '\x00'])
def test_an_unusable_metadata_file_is_done_without(
    make_bag: MakeBag, tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_bag(tmp_path / 'bag')
    whole = read(path)
    (path / 'metadata.yaml').write_text(text)
    assert read(path) == whole
    assert 'metadata.yaml: unreadable' in caplog.text


def test_a_missing_part_is_reported_and_the_rest_is_read(
    make_bag: MakeBag, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = make_bag(tmp_path / 'bag', pairs=30, split_bytes=30_000)
    whole = read(path)
    (path / 'bag_1.mcap').unlink()
    rest = read(path)
    assert 0 < len(rest) < len(whole)
    assert 'bag_1.mcap is listed in metadata.yaml but missing' in caplog.text


def test_an_empty_part_is_reported_and_the_rest_is_read(make_bag: MakeBag, tmp_path: Path) -> None:
    path = make_bag(tmp_path / 'bag', pairs=30, split_bytes=30_000)
    (path / 'bag_1.mcap').write_bytes(b'')
    with BagReader(path) as reader:
        assert 0 < reader.message_count < 60
        (warning,) = reader.warnings
    assert 'bag_1.mcap: file is empty' in warning


def test_damaged_messages_are_named(tmp_path: Path) -> None:
    path = tmp_path / 'bag'
    with BagWriter(path) as writer:
        writer.add_topic('/image', messages.COMPRESSED_IMAGE)
        writer.write('/image', 5, b'\x00\x01\x00\x00\xff\xff')
    with BagReader(path) as reader:
        record = next(reader.messages())
        with pytest.raises(BagError, match=r'/image: message at 5 ns is no sensor_msgs'):
            reader.decode(record)
