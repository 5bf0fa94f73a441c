"""An evaluation as one HTML file that needs nothing beside it, and as CSV files."""

from __future__ import annotations

import csv
import html
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from binopos_ros.evaluation.cells import Cell, Span, Table, Value
from binopos_ros.evaluation.figures import Figure
from binopos_ros.evaluation.settings import Settings
from binopos_ros.sheet import Made, drawing, sheet, table

#: Of a terminal, in characters.
WIDTH = 80
INDENT, GAP = '  ', '  '


def write_csv(folder: Path, tables: Iterable[Table]) -> list[Path]:
    """Write each table to its own file; the files.

    Figures are written as numbers, a span as two of them, and nothing where there is none.
    """
    written = []
    for made in tables:
        path = folder / f'{made.name}.csv'
        spans = {
            column
            for row in made.rows
            for column, cell in enumerate(row)
            if isinstance(cell, Span)
        }
        with path.open('w', newline='', encoding='utf-8') as file:
            writer = csv.writer(file)
            writer.writerow(
                name
                for column, title in enumerate(made.header)
                for name in ((f'{title}, low', f'{title}, high') if column in spans else (title,))
            )
            for row in made.rows:
                writer.writerow(
                    value
                    for column, cell in enumerate(row)
                    for value in _numbers(cell, column in spans)
                )
        written.append(path)
    return written


def _numbers(cell: Cell, spans: bool) -> Iterator[str]:
    if isinstance(cell, Span):
        yield from (f'{cell.low:.9g}', f'{cell.high:.9g}')
    else:
        # A figure in a column of spans is one from itself to itself.
        told = f'{cell.value:.9g}' if isinstance(cell, Value) else cell
        yield from (told, told) if spans else (told,)


def write_page(
    folder: Path,
    settings: Settings,
    tables: Iterable[Table],
    figures: Iterable[Figure],
    made: Made,
) -> Path:
    """Write evaluation.html; its path."""
    body = [
        f'<p>{html.escape(_about(settings))}</p>',
        *(_table(each) for each in tables),
        *(_figure(each) for each in figures),
    ]
    title = "The paper's experiments, and the comparison of filters"
    path = folder / 'evaluation.html'
    path.write_text(sheet(title, body, made), encoding='utf-8')
    return path


def as_text(made: Table) -> str:
    """A table for a terminal: columns that do not fit follow below, with the first one again."""
    lines = [made.header, *(tuple(map(str, row)) for row in made.rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(made.header))]
    text = textwrap.wrap(made.title, WIDTH)
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


def _table(made: Table) -> str:
    note = f'<p>{html.escape(made.note)}</p>' if made.note else ''
    return f'<h2>{html.escape(made.title)}</h2>{note}{table(made.rows, made.header)}'


def _figure(figure: Figure) -> str:
    return (
        f'<h2>{html.escape(figure.title)}</h2><p>The paper: {html.escape(figure.paper)}.</p>'
        f'{drawing(figure.svg, figure.title)}'
    )
