"""A whole evaluation, as small as it gets: tables, CSV, page, and going on where it was."""

from __future__ import annotations

import contextlib
import csv
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from binopos_ros.cli import main
from binopos_ros.evaluation import Results, Settings, Store, evaluate, tables
from binopos_ros.evaluation.cells import Span, Value
from binopos_ros.evaluation.comparison import error_ranges
from binopos_ros.evaluation.page import as_text, write_csv, write_page
from binopos_ros.sheet import Made

SMALL = Settings(experiments=2, frames=40, sequences=1)


class Labels:
    """A progress display that remembers what was worked on."""

    def __init__(self) -> None:
        self.worked: list[str] = []

    @contextlib.contextmanager
    def __call__(self, label: str, steps: int) -> Iterator[Callable[[], None]]:
        ticks: list[None] = []
        yield lambda: ticks.append(None)
        assert len(ticks) == steps
        self.worked.append(label)


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('evaluation')


@pytest.fixture(scope='module')
def results(folder: Path) -> Results:
    return evaluate(SMALL, Store(folder / 'parts'), Labels())


def test_every_table_is_whole(results: Results) -> None:
    made = {table.name: table for table in tables(results)}
    for table in made.values():
        assert table.rows
        assert all(len(row) == len(table.header) for row in table.rows)
        text = as_text(table)
        assert table.title in ' '.join(text.split())
        assert max(map(len, text.splitlines())) <= 80
    assert sum(row[1].value for row in made['table_5'].rows) == SMALL.experiments
    for axis in range(1, 4):
        assert sum(row[axis].value for row in made['table_6'].rows) == SMALL.experiments
    # The paper's own counts add up to its hundred, too.
    assert sum(row[4].value for row in made['table_5'].rows) == 100
    assert sum(row[5].value for row in made['table_6'].rows) == 100


def test_a_second_run_only_reads(results: Results, folder: Path) -> None:
    labels = Labels()
    again = evaluate(SMALL, Store(folder / 'parts'), labels)
    assert labels.worked == []
    assert tables(again) == tables(results)


def test_a_run_goes_on_with_the_parts_that_are_missing(results: Results, folder: Path) -> None:
    for part in (folder / 'parts').glob('fluctuating-kalman-*'):
        part.unlink()
    labels = Labels()
    again = evaluate(SMALL, Store(folder / 'parts'), labels)
    assert labels.worked == ['waves', 'fluctuating media: kalman']
    np.testing.assert_array_equal(again.fluctuating['kalman'], results.fluctuating['kalman'])


def test_csv_holds_numbers(results: Results, tmp_path: Path) -> None:
    made = tables(results)
    for table, path in zip(made, write_csv(tmp_path, made), strict=True):
        with path.open(newline='', encoding='utf-8') as file:
            header, *rows = csv.reader(file)
        assert len(set(header)) == len(header)
        assert len(rows) == len(table.rows)
        for row, cells in zip(rows, table.rows, strict=True):
            assert len(row) == len(header)
            expected = [
                value
                for cell in cells
                for value in (cell[:-1] if isinstance(cell, (Value, Span)) else ())
            ]
            found = [float(cell) for cell in row if cell and is_number(cell)]
            # A lone figure in a column of spans is one from itself to itself.
            assert set(np.round(expected, 3)) == set(np.round(found, 3))
            words = [cell for cell in cells if isinstance(cell, str) and cell]
            assert [cell for cell in row if cell and not is_number(cell)] == words
    with (tmp_path / 'table_5.csv').open(encoding='utf-8') as file:
        first = next(csv.DictReader(file))
    assert float(first["paper's range (mm), low"]) == -4.36
    assert float(first["paper's time (s)"]) == 5548.95


def is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def test_the_page_compares_with_the_paper_and_says_where_it_is_not_reached(
    results: Results, tmp_path: Path
) -> None:
    pytest.importorskip('matplotlib', reason='matplotlib is not installed')
    from binopos_ros.evaluation.figures import figures

    made, drawn = tables(results), figures(results)
    page = write_page(
        tmp_path, SMALL, made, drawn, Made('binopos evaluate', ['seed 1'])
    ).read_text(encoding='utf-8')
    assert page.count('<svg') == len(drawn) == 8
    assert page.count('<table>') == len(made)
    for words in ("the paper's band, ±4 mm", "the paper's range, 6.6 mm", '<li>seed 1</li>'):
        assert words in page
    own, kalman = (
        error_ranges(results.fluctuating[name]).mean() for name in ('cloud-kalman-paper', 'kalman')
    )
    assert ('The paper&#x27;s own filter does not reach' in page) == (own > 0.7666 * kalman)
    # Nothing is fetched, all follows the reader's colours, and every name is unique.
    assert not re.search(r'(src|href)="(?!#|data:)', page)
    assert 'prefers-color-scheme:dark' in page
    assert not re.search(r'(fill|stroke): #0102', page)
    names = re.findall(r' id="([^"]+)"', page)
    assert len(set(names)) == len(names)


def test_the_verb_writes_a_report(
    results: Results, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['--experiments', '2', '--sequences', '1']
    # The verb has the paper's 100 frames: its parts are its own.
    assert main(['evaluate', '-o', str(folder), *words]) == 0
    assert 'Table 5' in capsys.readouterr().out
    assert (folder / 'evaluation.html').is_file()
    assert (folder / 'table_6.csv').is_file()


def test_bad_input_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['evaluate', '-o', str(tmp_path), '--experiments', '1']) == 2
    error = capsys.readouterr().err
    assert error.startswith('binopos evaluate: ')
    assert error.count('\n') == 1
