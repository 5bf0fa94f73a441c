"""Every command that a document shows is run, or it is said why not."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path
from types import ModuleType

import pytest

from verbs import binopos_here

PROJECT = Path(__file__).resolve().parent.parent
#: A page whose commands do their work on a few pairs, so that what runs them is itself tried; all
#: pages as they stand take minutes: `make docs-commands`.
SHORT = 'docs/dives.md'
PAIRS = 1


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """What runs the documents' commands."""
    monkeypatch.syspath_prepend(str(PROJECT / 'docs'))
    return importlib.import_module('commands')


def test_every_command_is_run_or_it_is_said_why_not(shown: ModuleType) -> None:
    untold = [
        f'{path.name}: {line}'
        for path in shown.DOCUMENTS
        for line in shown.lines(path)
        if not shown.reason(line) and path.relative_to(PROJECT).as_posix() not in shown.PAGES
    ]
    assert untold == []


def test_nothing_that_is_run_stays_behind(shown: ModuleType) -> None:
    for name in shown.PAGES:
        for _, run in shown.commands(name):
            assert '&' not in run, f'{name}: {run}'


def test_every_reason_and_replacement_has_its_line_and_what_it_names(shown: ModuleType) -> None:
    every = [line for path in shown.DOCUMENTS for line in shown.lines(path)]
    for pattern, why in shown.NOT_RUN.items():
        assert any(re.match(pattern, line) for line in every), pattern
        for path in re.findall(r'(?:test|bench)/[\w/.]+\w', why):
            assert (PROJECT / path).exists(), path
    for name, page in shown.PAGES.items():
        text = '\n'.join(shown.lines(PROJECT / name))
        for word in page.words:
            assert re.search(word, text), f'{name}: {word}'


def test_a_short_page_runs(
    shown: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for line, run in shown.commands(SHORT, PAIRS):
        words = [
            each
            for word in shlex.split(run)[1:]
            for each in (sorted(map(str, Path().glob(word))) if '*' in word else [word])
        ]
        done = binopos_here(*words)
        assert done.returncode == 0, f'{line}\n{done.stdout}{done.stderr}'
