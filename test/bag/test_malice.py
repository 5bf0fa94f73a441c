"""Bags that lie, by the verb: each ends in one line, in a gigabyte and a half of addresses."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import pytest

import malice
from binopos_ros.bag import BagError, BagReader
from binopos_ros.bag.qos import parse_qos
from binopos_ros.optics import OpticsError, read_camera_info

pytestmark = pytest.mark.xdist_group('malice')

ADDRESSES = 1536 << 20


class Answer(NamedTuple):
    status: int
    stdout: str
    stderr: str


#: Runs verbs one after another, and says what came of each and how much memory all took.
PROCESS = """
import json, resource, sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from binopos_ros.cli import main
import binopos_ros.cli.process
answers = {}
for name, words in json.loads(sys.argv[1]).items():
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main(words)
    answers[name] = [status, out.getvalue(), err.getvalue()]
print(json.dumps([answers, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss]))
"""


def processed(folder: Path, bags: dict[str, Path]) -> tuple[dict[str, Answer], int]:
    """What `binopos process` says to each bag, and the most memory in KiB that it took."""
    verbs = {
        name: ['process', str(bag), '-o', str(folder / f'{name}.out.mcap')]
        for name, bag in bags.items()
    }
    done = subprocess.run(
        [sys.executable, '-c', PROCESS, json.dumps(verbs)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'},
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES)),
    )
    assert done.returncode == 0, done.stderr
    answers, most = json.loads(done.stdout.splitlines()[-1])
    return {name: Answer(*answer) for name, answer in answers.items()}, most


TRAPS = (
    'zstd_bomb', 'zstd_bomb_that_lies', 'zstd_bomb_that_is_silent', 'lz4_bomb',
    'lz4_bomb_that_lies', 'chunk_size_of_2_63', 'chunk_size_of_2_40', 'plain_chunk_size_of_2_63',
    'record_length_lie', 'schema_length_lie', 'unknown_compression', 'summary_of_the_whole_file',
    'file_bomb', 'message_bomb', 'silent_message_bomb', 'nested_metadata', 'laughing_metadata',
)  # fmt: skip


@pytest.fixture(scope='module')
def answers(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Answer], int]:
    folder = tmp_path_factory.mktemp('traps')
    bags = malice.traps(folder)
    bags['message_bomb'] = malice.message_bomb(folder / 'stated', stated=True)
    bags['silent_message_bomb'] = malice.message_bomb(folder / 'silent', stated=False)
    for name, text in (('nested', malice.NESTED), ('laughing', malice.LAUGHS)):
        bags[f'{name}_metadata'] = malice.image_bag(folder / name)
        (folder / name / 'metadata.yaml').write_text(text)
    return processed(folder, bags)


@pytest.mark.parametrize('name', TRAPS)
def test_a_trap_is_a_line(answers: tuple[dict[str, Answer], int], name: str) -> None:
    answer = answers[0][name]
    assert answer.status == 2, answer
    *warnings, line = answer.stderr.splitlines()
    assert line.startswith('binopos process: ')
    assert len(warnings) <= 1, answer.stderr
    assert all(len(each) < 400 for each in answer.stderr.splitlines())


def test_no_trap_takes_more_memory_than_the_largest_chunk(
    answers: tuple[dict[str, Answer], int],
) -> None:
    assert answers[1] < 700 * 1024


def test_a_packed_file_does_not_fill_the_temporary_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bomb = malice.traps(tmp_path)['file_bomb']
    unpacked = tmp_path / 'temporary'
    unpacked.mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(unpacked))
    with pytest.raises(BagError, match=r'more than .* MiB come out of its'):
        BagReader(bomb)
    assert list(unpacked.iterdir()) == []


@pytest.mark.parametrize('text', ['NESTED', 'LAUGHS', '\n' + '- ' * 20_000, '{a: ' * 20_000])
def test_a_calibration_that_never_ends_is_refused(tmp_path: Path, text: str) -> None:
    text = getattr(malice, text, text)
    (tmp_path / 'left.yaml').write_text(text if ': ' in text else f'a: {text}')
    with pytest.raises(OpticsError, match=r'nested more than|aliases') as refusal:
        read_camera_info(tmp_path / 'left.yaml')
    assert '\n' not in str(refusal.value)
    assert parse_qos(text) == []


@pytest.mark.parametrize(
    'text',
    ['when: 2001-99-99', f'n: {"9" * 5000}', '[a]: {[b]: c}', '\x00', '\ud800', '- &a [*a]'],
)
def test_yaml_that_its_library_chokes_on_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / 'left.yaml'
    path.write_bytes(text.encode('utf-8', 'surrogatepass'))
    with pytest.raises(OpticsError) as refusal:
        read_camera_info(path)
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize(
    'away', ['../secret/other.mcap', '{absolute}', 'a/../../secret/other.mcap']
)
def test_metadata_lead_nowhere_outside_the_bag(
    tmp_path: Path, away: str, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / 'secret').mkdir()
    malice.image_bag(tmp_path / 'secret' / 'other.mcap')
    bag = malice.image_bag(tmp_path / 'bag', pairs=2)
    away = away.format(absolute=tmp_path / 'secret' / 'other.mcap')
    text = (bag / 'metadata.yaml').read_text().replace('"bag_0.mcap"', f'"{away}"')
    (bag / 'metadata.yaml').write_text(text)
    with BagReader(bag) as reader:
        assert reader.message_count == 4
    assert 'is listed in metadata.yaml but missing' in caplog.text


def test_damage_by_the_hundred_is_messages_or_a_line(project: Path) -> None:
    """A hundred thousand: `python bench/bag/fuzz.py`."""
    bench = project / 'bench' / 'bag' / 'fuzz.py'
    done = subprocess.run(
        [sys.executable, str(bench), '1500', '7'], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert '1500 damaged bags' in done.stdout
