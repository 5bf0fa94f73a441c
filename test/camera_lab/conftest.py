"""Prints what the camera lab has measured at the end of the run."""

from __future__ import annotations

import pytest

LINES = pytest.StashKey[list[str]]()


@pytest.fixture(scope='module')
def tell(request):
    """Takes a line for the end of the run."""
    return request.config.stash.setdefault(LINES, []).append


def pytest_terminal_summary(terminalreporter, config):
    for line in config.stash.get(LINES, ()):
        terminalreporter.write_line(line)
