"""An evaluation as one HTML file that needs nothing beside it, and as CSV files."""

from __future__ import annotations

import base64
import csv
import html
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path

from binopos_ros.evaluation.figures import Figure
from binopos_ros.evaluation.settings import Settings
from binopos_ros.evaluation.tables import Table

#: Of a terminal, in characters.
WIDTH = 80
INDENT, GAP = '  ', '  '
STYLE = (
    'body{font:15px/1.45 sans-serif;max-width:75em;margin:2em auto;padding:0 1em}'
    'img{max-width:100%}table{border-collapse:collapse}'
    'td,th{padding:.15em .8em .15em 0;text-align:right;border-bottom:1px solid #ddd}'
    'td:first-child,th:first-child{text-align:left}.note{color:#555;max-width:55em}'
)


def write_csv(folder: Path, tables: Iterable[Table]) -> list[Path]:
    """Write each table to its own file; the files."""
    written = []
    for table in tables:
        path = folder / f'{table.name}.csv'
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(table.header)
            writer.writerows(table.rows)
        written.append(path)
    return written


def write_page(
    folder: Path, settings: Settings, tables: Iterable[Table], figures: Iterable[Figure]
) -> Path:
    """Write evaluation.html; its path."""
    parts = [
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8">',
        f'<title>Evaluation</title><style>{STYLE}</style></head><body>',
        "<h1>The paper's experiments, and the comparison of filters</h1>",
        f'<p>{html.escape(_about(settings))}</p>',
        *(_table(table) for table in tables),
        *(_figure(figure) for figure in figures),
        '</body></html>',
    ]
    path = folder / 'evaluation.html'
    path.write_text('\n'.join(parts), encoding='utf-8')
    return path


def as_text(table: Table) -> str:
    """A table for a terminal: columns that do not fit follow below, with the first one again."""
    lines = [table.header, *table.rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(table.header))]
    text = textwrap.wrap(table.title, WIDTH)
    for number, columns in enumerate(_columns_that_fit(widths)):
        if number:
            text.append('')
        for line in lines:
            cells = [
                line[0].ljust(widths[0]),
                *(line[each].rjust(widths[each]) for each in columns),
            ]
            text.append(f'{INDENT}{GAP.join(cells)}'.rstrip())
    return '\n'.join(text)


def _columns_that_fit(widths: Sequence[int]) -> list[list[int]]:
    """The columns after the first, in groups that fit beside it."""
    groups: list[list[int]] = [[]]
    used = start = len(INDENT) + widths[0]
    for column, width in enumerate(widths[1:], 1):
        if groups[-1] and used + len(GAP) + width > WIDTH:
            groups.append([])
            used = start
        groups[-1].append(column)
        used += len(GAP) + width
    return groups


def _about(settings: Settings) -> str:
    return (
        f'{settings.experiments} experiments of {settings.frames} pairs in each medium, '
        f'{settings.sequences} unseen sequences, {settings.pixel_std} px of noise, seed '
        f'{settings.seed}. Simulated with the true media: Snell at the surface, in twenty layers '
        'of salt water, and at the wavy surface of each instant.'
    )


def _table(table: Table) -> str:
    head = ''.join(f'<th>{html.escape(cell)}</th>' for cell in table.header)
    body = ''.join(
        '<tr>' + ''.join(f'<td>{html.escape(cell)}</td>' for cell in row) + '</tr>'
        for row in table.rows
    )
    note = f'<p class="note">{html.escape(table.note)}</p>' if table.note else ''
    return f'<h2>{html.escape(table.title)}</h2><table><tr>{head}</tr>{body}</table>{note}'


def _figure(figure: Figure) -> str:
    picture = base64.b64encode(figure.png).decode('ascii')
    return (
        f'<h2>{html.escape(figure.title)}</h2><p class="note">The paper: '
        f'{html.escape(figure.paper)}.</p><img alt="{html.escape(figure.title)}" '
        f'src="data:image/png;base64,{picture}">'
    )
