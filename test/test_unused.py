"""What nobody uses goes: options, flags, constants and figures."""

from __future__ import annotations

import ast
import dataclasses
import re
import typing
from collections.abc import Iterator
from pathlib import Path

import pytest

from binopos_ros.node_options import NODES, options_types
from binopos_ros.smoothing import FILTERS

PROJECT = Path(__file__).parents[1]
PACKAGE = PROJECT / 'binopos_ros'
TREES = {
    file: ast.parse(file.read_text(encoding='utf-8')) for file in sorted(PACKAGE.rglob('*.py'))
}
READ: set[str] = set()
CALLS: list[tuple[Path, ast.Call]] = []
WORDS: set[str] = set()
for path, parsed in TREES.items():
    for each in ast.walk(parsed):
        if isinstance(each, ast.Attribute) and isinstance(each.ctx, ast.Load):
            READ.add(each.attr)
        elif isinstance(each, ast.Name) and isinstance(each.ctx, ast.Load):
            READ.add(each.id)
        elif isinstance(each, ast.ImportFrom):
            READ.update(alias.name for alias in each.names)
        elif isinstance(each, ast.Call):
            CALLS.append((path, each))
        elif isinstance(each, ast.Constant) and isinstance(each.value, str):
            WORDS.add(each.value)


def fields_of(options: type) -> Iterator[str]:
    hints = typing.get_type_hints(options)
    for field in dataclasses.fields(options):
        if dataclasses.is_dataclass(hints[field.name]):
            yield from fields_of(typing.cast(type, hints[field.name]))
        else:
            yield field.name


@pytest.mark.parametrize('node', NODES)
def test_every_option_of_a_node_is_read(node: str) -> None:
    methods = FILTERS if node == 'smoother' else (None,)
    types = {each for method in methods for each in options_types(node, method)}
    assert [name for each in types for name in fields_of(each) if name not in READ] == []


def destination(call: ast.Call) -> str:
    """The attribute under which argparse keeps what was typed."""
    for keyword in call.keywords:
        if keyword.arg == 'dest' and isinstance(keyword.value, ast.Constant):
            return str(keyword.value.value)
    words = [word.value for word in call.args if isinstance(word, ast.Constant)]
    long = [word for word in words if word.startswith('--')]
    return str((long or words or [''])[0]).lstrip('-').replace('-', '_')


def test_every_flag_is_read() -> None:
    unread = []
    for file, call in CALLS:
        if getattr(call.func, 'attr', '') == 'add_argument':
            name = destination(call)
            # Some are looked up by a name that is kept as a word, or put together of two.
            parts = ({name[:k], name[k:]} for k in range(1, len(name)))
            read = name in READ or name in WORDS or any(p <= WORDS for p in parts)
            if not read:
                unread.append(f'{file.name}: {name}')
    assert unread == []


def test_every_constant_is_used() -> None:
    # The tests speak the kernel's language too, and benches use what the suite itself does not.
    used = READ | {
        word
        for folder in ('test', 'bench')
        for file in (PROJECT / folder).rglob('*.py')
        for word in re.findall(r'\w+', file.read_text(encoding='utf-8'))
    }
    unused = [
        f'{file.relative_to(PROJECT)}: {target.id}'
        for file, tree in TREES.items()
        for statement in tree.body
        if isinstance(statement, (ast.Assign, ast.AnnAssign))
        for target in getattr(statement, 'targets', [getattr(statement, 'target', None)])
        if isinstance(target, ast.Name) and target.id != '__all__' and target.id not in used
    ]
    assert unused == []


def test_every_figure_is_shown_and_every_script_of_one_is_named() -> None:
    pages = ''.join(
        page.read_text(encoding='utf-8')
        for page in (PROJECT / 'README.md', *sorted((PROJECT / 'docs').rglob('*.md')))
    )
    scripts = {file: file.read_text() for file in (PROJECT / 'docs' / 'figures').glob('*.py')}
    lost = [
        file.name
        for file in sorted((PROJECT / 'docs' / 'figures').iterdir())
        if file.is_file() and file.name not in pages
        # A script without a page of its own makes what some page shows.
        if not (file in scripts and any(f'{file.stem}.{kind}' in pages for kind in ('png', 'jpg')))
    ]
    assert lost == []
