"""`binopos simulate` as a user meets it."""

from __future__ import annotations

from pathlib import Path

import pytest

from binopos_ros.bag import BagReader
from binopos_ros.cli import main


def test_it_writes_a_bag_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / 'bowl'
    status = main(
        ['simulate', '-o', str(bag), '--preset', 'demo', '--pairs', '2', '--still', '--seed', '3']
    )
    assert status == 0
    assert 'bowl: 2 pairs, 0.1 s' in capsys.readouterr().out
    with BagReader(bag) as reader:
        assert reader.topics['/stereo/truth/pose'].count == 2


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['--pairs', '0'], '0 pairs make no bag'),
        (['--noise', '-1'], 'noise is -1.0: give'),
        (['--waves', '-0.001'], 'wave height is -0.001 m'),
        (['--waves', 'nan'], 'wave height is nan m'),
        (['--salt', '1.544'], 'salt water of index 1.544 does not exist'),
        (['--preset', 'ports', '--waves', '0.001'], 'the ports have none'),
        (['--quality', '0'], 'JPEG quality is 0'),
        (['--rate', '0'], 'rate is 0.0 pairs per second'),
        (['--diameter', '-0.1'], 'disc is -0.1 m wide'),
        (['--period', '0'], 'period of the path is 0.0 s'),
        (['--seed', '-1'], 'seed is -1'),
        (['--distractors', '1000'], '1000 distractors'),
        (['--threads', '0'], '0 threads'),
        (['--wave-peak', '40', '--waves', '0.001'], '40.0 Hz'),
        (['--board', '9x6', '--still'], '--board has no path'),
        (['--air', '--salt', '1.35'], '--air has no salt'),
        (['--board', 'nine'], 'write columns x rows'),
        (['--board', '9x6', '--square', '20'], 'write 0.02'),
        (['--board', '40x30', '--square', '0.05'], 'give a smaller board'),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_bag(
    words: list[str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / 'bag'
    assert main(['simulate', '-o', str(bag), '--preset', 'demo', *words]) == 2
    error = capsys.readouterr().err
    assert error.startswith('binopos simulate: ')
    assert error.count('\n') == 1
    assert complaint in error
    assert not bag.exists()


def test_an_existing_bag_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['simulate', '-o', str(tmp_path), '--preset', 'demo']) == 2
    assert 'exist' in capsys.readouterr().err
