"""What the verbs' tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

from other_bags import PAIRS
from verbs import simulated


@pytest.fixture(scope='session')
def demo_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short bag by the simulator, each of whose pairs gives a position."""
    return simulated(tmp_path_factory.mktemp('demo') / 'bag', 'demo', PAIRS)
