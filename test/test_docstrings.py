"""The examples in the docstrings of all that is public run, and print what stands there."""

from __future__ import annotations

import doctest
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

DOCS = Path(__file__).resolve().parent.parent / 'docs'


@pytest.fixture
def declared(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """What makes the reference: it knows what is public."""
    monkeypatch.syspath_prepend(str(DOCS))
    return importlib.import_module('declared')


def examples(declared: ModuleType, name: str) -> Iterator[doctest.DocTest]:
    """Of a public module: its own, and those of its public names."""
    module = importlib.import_module(name)
    parser = doctest.DocTestParser()
    members: list[tuple[str, Any]] = [(name, module)]
    for own in declared.public_names(module):
        value = getattr(module, own)
        members.append((f'{name}.{own}', value))
        if inspect.isclass(value):
            methods = inspect.getmembers(value, inspect.isroutine)
            members += [(f'{name}.{own}.{each}', method) for each, method in methods]
    for label, value in members:
        text = inspect.getdoc(value) or ''
        if '>>>' in text:
            scope = {**vars(inspect.getmodule(value) or module)}
            yield parser.get_doctest(text, scope, label, None, None)


def test_the_examples_of_every_room_run(declared: ModuleType) -> None:
    told: list[str] = []
    without = set()
    for name in declared.MODULES:
        found = list(examples(declared, name))
        if not found:
            without.add(name)
        for each in found:
            runner = doctest.DocTestRunner(verbose=False, optionflags=doctest.ELLIPSIS)
            runner.run(each, out=told.append)
    assert not told, ''.join(told)
    # Its functions take minutes; `binopos evaluate` is run by its own tests.
    assert without <= {'binopos_ros.evaluation'}
