"""`binopos simulate` as a user meets it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from binopos_ros.bag import BagReader
from binopos_ros.cli import main
from binopos_ros.simulation.presets import Choices, ports


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
        (['--swing', '5'], 'swing one behind ports'),
        (['--motion', 'hover'], 'let it carry one behind ports'),
        (['--odometry-rate', '20'], 'give --motion too'),
        (['--preset', 'ports', '--swing', '90'], '90 degrees'),
        (['--preset', 'ports', '--swing', '5', '--swing-period', '0'], '0.0 s'),
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


def test_a_rig_that_swings_sees_a_still_target_on_an_arc_at_its_distance() -> None:
    still = ports(Choices(path='still'))
    swung = ports(Choices(path='still', swing=np.radians(5.0), swing_period=1.0))
    times = np.arange(30) / 30.0
    place, seen = still.path.poses(times)[0], swung.path.poses(times)[0]
    np.testing.assert_allclose(
        np.linalg.norm(seen, axis=1), np.linalg.norm(place, axis=1), rtol=1e-12
    )
    # Turned to the right, the rig sees the target to its left.
    bearing = np.degrees(np.arctan2(seen[:, 0], seen[:, 2]) - np.arctan2(place[:, 0], place[:, 2]))
    np.testing.assert_allclose(bearing, -5.0 * np.sin(2 * np.pi * times), atol=1e-9)
