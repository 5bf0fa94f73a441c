"""The status of `run` and `replay`: in place on a terminal, a line per ten seconds in a pipe."""

from __future__ import annotations

import io
import os

import pytest

from binopos_ros.cli import status_line
from binopos_ros.cli.status_line import StatusLine


class Out(io.StringIO):
    """What a terminal or a pipe is sent."""

    def __init__(self, is_terminal: bool) -> None:
        super().__init__()
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal

    def screen(self, columns: int) -> list[str]:
        """The rows that a terminal shows: it folds, and obeys a return and an erased line."""
        rows = ['']
        text = self.getvalue().replace('\x1b[K', '\0')
        for each in text:
            if each == '\n':
                rows.append('')
            elif each == '\r':
                rows[-1] = ''  # Nothing but an erased line follows here.
            elif each != '\0':
                if len(rows[-1]) == columns:
                    rows.append('')
                rows[-1] += each
        return rows


@pytest.fixture
def clock(monkeypatch):
    now = [1000.0]
    monkeypatch.setattr(status_line.time, 'monotonic', lambda: now[0])
    return now


@pytest.mark.parametrize('length', [10, 79, 80, 300])
def test_on_a_terminal_the_line_stays_in_one_row(monkeypatch, clock, length):
    out = Out(is_terminal=True)
    monkeypatch.setattr('sys.stdout', out)
    monkeypatch.setattr(
        status_line.shutil, 'get_terminal_size', lambda: os.terminal_size((80, 24))
    )
    line = StatusLine()
    for number in range(100):
        line.show(f'{number:>{length}}')
        clock[0] += 0.1
    line.end()
    assert len(out.screen(80)) == 2
    assert out.screen(80)[1] == ''
    # A person can follow it.
    assert out.getvalue().count('\r') < 50


def test_what_else_is_said_stands_on_its_own(monkeypatch, capsys, clock):
    out = Out(is_terminal=True)
    monkeypatch.setattr('sys.stdout', out)
    line = StatusLine()
    line.show('tracking')
    line.report('the smoother died')
    assert out.screen(80) == ['']
    assert capsys.readouterr().err == 'the smoother died\n'
    clock[0] += 1.0
    line.show('tracking')
    assert out.screen(80) == ['tracking']


def test_in_a_pipe_it_is_a_line_per_ten_seconds(monkeypatch, clock):
    out = Out(is_terminal=False)
    monkeypatch.setattr('sys.stdout', out)
    line = StatusLine()
    for _ in range(350):
        line.show('tracking')
        clock[0] += 0.1
    line.end()
    assert out.getvalue() == 'tracking\n' * 4
