"""Puts the tables of `bench/results/` into the documents.

    python bench/pages.py            rewrites what has changed
    python bench/pages.py --check    only tells; exit status 1 where a page is not what they say

In a document a table stands between two comments, and is written anew as a whole:

    <!-- figures: smoothing/speed steps -->
    <!-- end of figures -->

With `alone` as a third word it is the table alone, without its losses and what it was run on.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

from figures import FORM, RESULTS, Column, line, written

PROJECT = Path(__file__).resolve().parent.parent
BLOCK = re.compile(
    r'(?P<begin><!-- figures: (?P<bench>\S+) (?P<table>\S+)(?P<alone> alone)? -->\n).*?'
    r'(?P<end><!-- end of figures -->)',
    re.DOTALL,
)


class PageError(Exception):
    """A document asks for figures that are not there, or not of this form."""


def documents() -> list[Path]:
    """Return the pages that may hold figures."""
    return [PROJECT / 'README.md', *sorted((PROJECT / 'docs').glob('*.md'))]


def result(bench: str) -> dict[str, Any]:
    """Read what a bench found.

    Raises PageError where there is nothing, or it was kept in another form.
    """
    path = RESULTS / f'{bench}.json'
    if not path.is_file():
        msg = f'{bench}: no {path.name}; run the bench (python bench/{bench}.py)'
        raise PageError(msg)
    found: dict[str, Any] = json.loads(path.read_text(encoding='utf-8'))
    if found.get('form') != FORM:
        msg = f'{bench}: kept in form {found.get("form")}, not {FORM}; run the bench again'
        raise PageError(msg)
    return found


def rendered(bench: str, key: str, alone: bool) -> str:
    """Return a table in Markdown; unless alone, with its losses and what it was run on."""
    found = result(bench)
    if key not in found['tables']:
        msg = f'{bench}: no table {key}; it has {", ".join(found["tables"])}'
        raise PageError(msg)
    table = found['tables'][key]
    columns = [Column(**each) for each in table['columns']]
    titles = [table['heading'], *(column.title for column in columns)]
    lines = [line(titles), '|---' * len(titles) + '|']
    spread = False
    for name, cells in table['rows']:
        lines.append(line([name, *map(written, cells, columns)]))
        spread |= any(isinstance(cell, dict) for cell in cells)
    if alone:
        return '\n'.join(lines)
    lines.append('')
    if table['losses']:
        lines += [f'Losses: {"; ".join(table["losses"])}.', '']
    kept = {name: value for name, value in found['versions'].items() if value != '-'}
    settings = [f'{name} {value}' for name, value in found['settings'].items() if value]
    lines += [
        f'*{", ".join(settings).capitalize() + ". " if settings else ""}'
        f'{"Medians, with quartiles in brackets. " if spread else ""}'
        f'{found["machine"]["processor"]}, {found["machine"]["cores"]} cores, load '
        f'{found["machine"]["load"]} before the run; '
        f'{", ".join(f"{name} {value}" for name, value in kept.items())}; '
        f'commit {found["commit"]}.*'
    ]
    return '\n'.join(lines)


def filled(text: str) -> str:
    """Return a document with its tables as the results have them."""

    def block(found: re.Match[str]) -> str:
        table = rendered(found['bench'], found['table'], bool(found['alone']))
        return f'{found["begin"]}\n{table}\n\n{found["end"]}'

    return BLOCK.sub(block, text)


def main() -> int:
    parser = argparse.ArgumentParser(description='Puts the figures into the documents.')
    parser.add_argument('--check', action='store_true', help='change nothing')
    check = parser.parse_args().check
    status = 0
    for path in documents():
        text = path.read_text(encoding='utf-8')
        try:
            new = filled(text)
        except PageError as fault:
            print(f'{path.name}: {fault}', file=sys.stderr)
            status = 1
            continue
        if new != text:
            print(f'{path.name} {"is not what the results say" if check else "written"}')
            status |= check
            if not check:
                path.write_text(new, encoding='utf-8')
    return status


if __name__ == '__main__':
    raise SystemExit(main())
