"""What the verbs' tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

import moving_robot
from moving_robot import process
from other_bags import PAIRS
from verbs import binopos, simulated


@pytest.fixture(scope='session')
def demo_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short bag by the simulator, each of whose pairs gives a position."""
    return simulated(tmp_path_factory.mktemp('demo') / 'bag', 'demo', PAIRS)


@pytest.fixture(scope='session')
def hovering_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A target at rest, seen from a robot that hovers a metre before it."""
    folder = tmp_path_factory.mktemp('hover') / 'bag'
    done = binopos(
        *('simulate', '-o', folder, '--preset', 'ports', '--still', '--motion', 'hover'),
        *('--pairs', moving_robot.PAIRS, '--seed', 3, '--distractors', 0),
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope='session')
def hovering_processed(hovering_bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `process` makes of the bag by its own parameters."""
    folder = tmp_path_factory.mktemp('processed')
    process(hovering_bag, folder)
    return folder
