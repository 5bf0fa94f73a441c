"""The pages of the reference, made from the declarations in the code when the site is built."""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from binopos_ros.cli import VERBS
from binopos_ros.cli.parser import VerbParser
from binopos_ros.node_options import NODES, options_types
from binopos_ros.parameters import ParameterSpec, specs_of
from binopos_ros.smoothing.stage import SmootherOptions

#: Public faces of the rooms, in the order in which data flows.
MODULES = (
    'binopos_ros',
    'binopos_ros.optics',
    'binopos_ros.detection',
    'binopos_ros.triangulation',
    'binopos_ros.platform',
    'binopos_ros.smoothing',
    'binopos_ros.calibration',
    'binopos_ros.bag',
    'binopos_ros.simulation',
    'binopos_ros.evaluation',
)
ROOT = Path(__file__).resolve().parent.parent
#: Where links of the repository's root lead on the site, seen from its reference.
SITE = {
    'docs/': '../',
    'config/binopos.yaml': 'parameters.md',
    'CONTRIBUTING.md': 'contributing.md',
    'SECURITY.md': 'policy.md',
    'CHANGELOG.rst': '../changes.md',
}
SECTION = re.compile(r'^(Args|Attributes|Examples|Raises|Returns|Yields):$')
ENTRY = re.compile(r'^(\*{0,2}[\w., `*]+):\s+(.*)$')


def write_reference(folder: Path) -> None:
    """Write the pages into a folder."""
    folder.mkdir(exist_ok=True)
    pages = {
        'topics': topics(),
        'parameters': parameters(),
        'verbs': verbs(),
        'api': api(),
        'contributing': from_root('CONTRIBUTING.md'),
        'policy': from_root('SECURITY.md'),
    }
    for name, lines in pages.items():
        (folder / f'{name}.md').write_text('\n'.join(lines) + '\n', encoding='utf-8')


def topics() -> Iterator[str]:
    """The tables of topics and nodes, which the README has; a test holds them to the code."""
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    start, end = text.index('## Topics'), text.index('What the cameras look through is given once')
    yield f'# Topics and nodes\n\n{_on_site(text[start:end])}'


def from_root(name: str) -> Iterator[str]:
    """A page of the repository's root."""
    yield _on_site((ROOT / name).read_text(encoding='utf-8'))


def _on_site(text: str) -> str:
    """A text of the repository's root with its links as the site has them."""
    for path, page in SITE.items():
        text = text.replace(f']({path}', f']({page}')
    return text


def parameters() -> Iterator[str]:
    """Every parameter of every node."""
    yield '# Parameters of the nodes\n'
    yield 'How they are given: [Parameters](../parameters.md).'
    for node in NODES:
        types = options_types(node)
        if not types:
            continue
        yield f'\n## {node}\n'
        own = types if node != 'smoother' else types[:-1]
        yield from _table({k: v for each in own for k, v in specs_of(each).items()})
        if node == 'smoother':
            for method in specs_of(SmootherOptions)['method'].choices:
                special = specs_of(options_types(node, method)[-1])
                yield f'\n### With method {method}\n'
                yield from _table(special) if special else ['It takes no more.']


def _table(specs: dict[str, ParameterSpec]) -> Iterator[str]:
    yield '| parameter | type | default | may be | meaning |\n|---|---|---|---|---|'
    for name, spec in specs.items():
        kind = f'list of {spec.element.__name__}' if spec.element else spec.kind.__name__
        default = '' if spec.default is None else f'`{_plain(spec.default)}`'
        limits = ''
        if spec.choices:
            limits = ', '.join(f'`{choice}`' for choice in spec.choices)
        elif spec.limits:
            limits = f'{spec.limits[0]:g} to {spec.limits[1]:g}'
        if spec.read_only:
            limits = f'{limits}; fixed at the start'.removeprefix('; ')
        yield f'| `{name}` | {kind} | {default} | {limits} | {_cell(spec.description)} |'


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return str(list(value)) if isinstance(value, tuple) else str(value) or "''"


def _cell(text: str) -> str:
    return text.replace('|', '\\|').replace('<', '&lt;')


def verbs() -> Iterator[str]:
    """What `--help` says of every verb, on 80 columns."""
    os.environ['COLUMNS'] = '80'
    yield '# Verbs\n'
    yield 'What `binopos VERB --help` says.'
    for verb, line in VERBS.items():
        parser = VerbParser(prog=f'binopos {verb}', description=f'{line}.')
        importlib.import_module(f'binopos_ros.cli.{verb}').add_arguments(parser)
        yield f'\n## {verb}\n'
        yield f'```text\n{parser.format_help()}```'
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                for kind, each in action.choices.items():
                    yield f'\n### {verb} {kind}\n'
                    yield f'```text\n{each.format_help()}```'


def api() -> Iterator[str]:
    """The public names of the rooms, with their docstrings."""
    yield '# Python\n'
    yield 'Each room is a package of its own, without ROS. Arrays may be batched: (N, 2), (N, 3).'
    for module_name in MODULES:
        module = importlib.import_module(module_name)
        yield f'\n## {module_name}\n'
        yield from _described(inspect.getdoc(module) or '')
        for name in public_names(module):
            yield from _member(module_name, name, getattr(module, name))


def public_names(module: ModuleType) -> Sequence[str]:
    """The names of a room's face; some are imported only when they are asked for."""
    names: Sequence[str] | None = getattr(module, '__all__', None)
    return names or tuple(getattr(module, 'FACE', ('Tracker',)))


def _member(module_name: str, name: str, value: Any) -> Iterator[str]:
    if inspect.isclass(value) or inspect.isroutine(value):
        yield f'\n### {module_name}.{name}\n'
        yield f'```python\n{name}{_signature(value)}\n```'
        yield from _described(inspect.getdoc(value) or '')
    if inspect.isclass(value) and not issubclass(value, Exception):
        for own, each in inspect.getmembers(value, _is_method):
            if not own.startswith('_') and own in vars(value):
                yield f'\n**`.{own}{_signature(each)}`**\n'
                yield from _described(inspect.getdoc(each) or '')


def _is_method(value: Any) -> bool:
    return inspect.isroutine(value) or isinstance(value, property)


def _signature(value: Any) -> str:
    if isinstance(value, property):
        return ''
    try:
        text = str(inspect.signature(value))
    except (TypeError, ValueError):
        return '(...)'
    for long in ('numpy.ndarray[tuple[typing.Any, ...], numpy.dtype[numpy.float64]]',):
        text = text.replace(long, 'Array')
    return text.replace("'", '').replace('(self, ', '(').replace('(self)', '()')


def _described(docstring: str) -> Iterator[str]:
    """A docstring as Markdown: sections become lists, whichever of two styles they are in."""
    inside = underlined = False
    lines = docstring.splitlines()
    example = False
    for line, following in zip(lines, [*lines[1:], ''], strict=True):
        if line.strip().startswith('>>>') and not example:
            example = True
            yield '\n```pycon'
        if example:
            example = bool(line.strip())
            yield line.strip() if example else '```\n'
            continue
        if following and set(following) == {'-'}:
            inside = underlined = True
            yield f'\n*{line.strip()}:*\n'
        elif line and set(line) == {'-'}:
            continue
        elif underlined and line and not line.startswith(' '):
            name, _, kind = line.partition(' : ')
            yield f'- `{name}`: {_cell(kind)}' if kind else f'- `{name}`'
        elif SECTION.match(line.strip()) and not line.startswith(' '):
            inside = True
            yield f'\n*{line.strip()}*\n'
        elif inside and (entry := ENTRY.match(line.strip())) and _indent(line) == 4:
            yield f'- `{entry[1].replace("`", "")}`: {_cell(entry[2])}'
        elif inside:
            yield f'  {_cell(line.strip())}'
        else:
            yield _cell(line.replace('``', '`'))
    yield '```\n' if example else ''


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())
