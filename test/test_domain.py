"""Two runs of the tests on one machine do not talk to each other."""

from __future__ import annotations

import fcntl
import tempfile
from pathlib import Path

import pytest


def test_the_domain_is_locked_against_other_runs(ros_domain):
    path = Path(tempfile.gettempdir()) / f'binopos_test_domain_{ros_domain}.lock'
    with path.open('w') as other, pytest.raises(BlockingIOError):
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
