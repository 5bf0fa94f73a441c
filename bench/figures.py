"""What a bench found: printed as it comes, and kept as `bench/results/NAME.json`.

A bench says once what its tables hold, adds rows, and keeps them when it has run to its end:

    found = Figures('smoothing/speed', peers=('filterpy',))
    steps = found.table('steps', 'filter', Column('us', '.1f'), Column('of filterpy', '.2f', '>'))
    steps.row('kalman', samples, ratio)
    found.keep()

A cell is a number, a word, None where there is nothing to say, or a list of samples: of these the
median, the quartiles, the range and the number are kept. `python bench/pages.py` puts the tables
into the documents.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import cv2
import numpy as np

#: Of the JSON: a page made from another one is refused.
FORM = 1
RESULTS = Path(__file__).resolve().parent / 'results'
Cell = float | str | None | Sequence[float]
Setting = float | str | None


@dataclass(frozen=True)
class Column:
    """A heading with its unit, how its numbers are written, and on which side of 1 they lose.

    `loss` is '<' for how many times faster than a peer, '>' for how many times its time, and ''
    where nothing is compared.
    """

    title: str
    form: str = ''
    loss: str = ''


@dataclass
class Table:
    """Rows under headings; the first heading is that of the rows' names."""

    heading: str
    columns: tuple[Column, ...]
    rows: list[tuple[str, list[Any]]] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)

    def row(self, name: str, *cells: Cell, compared: bool = True) -> None:
        """Add a row and print it, below the headings if it is the first.

        One that is not `compared` is no loss, whatever it says: a peer's own.
        """
        if not self.rows:
            titles = [self.heading, *(column.title for column in self.columns)]
            print('\n' + line(titles) + '\n' + '|---' * len(titles) + '|')
        kept = [summary(cell) for cell in cells]
        self.rows.append((name, kept))
        if compared:
            self.losses += losses(name, kept, self.columns)
        print(line([name, *map(written, kept, self.columns)]), flush=True)


class Figures:
    """All that one run of a bench found.

    `name` is the bench's path below `bench/`, without its ending, and with `.PART` after it where
    a bench is run in several ways; `peers` are the distributions it compares with, `settings` what
    a run may be given.
    """

    def __init__(self, name: str, peers: Sequence[str] = (), **settings: Setting) -> None:
        self.name, self.settings = name, settings
        self.tables: dict[str, Table] = {}
        # At the start: a bench loads the machine itself.
        self.conditions = {
            'commit': commit(),
            'machine': machine(),
            'versions': versions(peers),
        }

    def table(self, key: str, heading: str, *columns: Column) -> Table:
        """Begin a table, which pages know by `key`."""
        self.tables[key] = Table(heading, columns)
        return self.tables[key]

    def keep(self) -> None:
        """Write the JSON."""
        kept = {
            'form': FORM,
            'bench': self.name,
            'settings': self.settings,
            **self.conditions,
            'tables': {key: asdict(table) for key, table in self.tables.items()},
        }
        path = RESULTS / f'{self.name}.json'
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(kept, indent=1, ensure_ascii=False) + '\n', encoding='utf-8')


def summary(cell: Cell) -> Any:
    """Return what is kept of a cell."""
    if cell is None or isinstance(cell, str):
        return cell
    samples = np.asarray(cell, dtype=float)
    if samples.ndim == 0:
        return rounded(samples) if np.isfinite(samples) else None
    low, median, high = np.percentile(samples, (25, 50, 75))
    return {
        'median': rounded(median),
        'quartiles': [rounded(low), rounded(high)],
        'range': [rounded(samples.min()), rounded(samples.max())],
        'samples': samples.size,
    }


def rounded(value: Any) -> float:
    """Return six digits of a number: more would change with every run and tell nothing."""
    return float(f'{float(value):.6g}')


def middle(kept: Any) -> Any:
    """Return the one number of a kept cell, or its word."""
    return kept['median'] if isinstance(kept, dict) else kept


def written(kept: Any, column: Column) -> str:
    """Return a kept cell as tables show it: a median with its quartiles in brackets."""
    if kept is None:
        return '-'
    if isinstance(kept, str):
        return kept
    if not isinstance(kept, dict):
        return format(kept, column.form)
    low, high = (format(each, column.form) for each in kept['quartiles'])
    return f'{kept["median"]:{column.form}} ({low} to {high})'


def losses(name: str, cells: Sequence[Any], columns: Sequence[Column]) -> list[str]:
    """Return where the peers of a row are ahead, a phrase each."""
    found = []
    for column, kept in zip(columns, cells, strict=True):
        value = middle(kept)
        if isinstance(value, float) and (
            (column.loss == '<' and value < 1.0) or (column.loss == '>' and value > 1.0)
        ):
            found.append(f'{name}: {value:{column.form}} ({column.title})')
    return found


def line(cells: Sequence[str]) -> str:
    """Return a row of a Markdown table."""
    return '| ' + ' | '.join(cells) + ' |'


def commit() -> str:
    """Return the commit that is run, with a + where files differ from it."""

    def git(*words: str) -> str:
        done = subprocess.run(
            ['git', *words], cwd=RESULTS.parent, capture_output=True, text=True, check=False
        )
        return done.stdout.strip()

    changed = git('status', '--porcelain', '--untracked-files=no', '--', '../binopos_ros', '.')
    others = [each for each in changed.splitlines() if 'bench/results/' not in each]
    return git('rev-parse', '--short', 'HEAD') + ('+' if others else '')


def machine() -> dict[str, Any]:
    """Return what kind of machine this is, and how busy it was before the bench."""
    model = platform.machine()
    info = Path('/proc/cpuinfo')
    if info.exists():
        for each in info.read_text(encoding='utf-8').splitlines():
            if each.startswith('model name'):
                model = each.partition(':')[2].strip()
                break
    return {
        'processor': model,
        'cores': os.cpu_count(),
        'load': round(os.getloadavg()[0], 1),
    }


def versions(names: Sequence[str]) -> dict[str, str]:
    """Return the versions of what all run on and of peers, '-' for one that is not installed."""
    found = {
        'Python': platform.python_version(),
        'numpy': np.__version__,
        'OpenCV': cv2.__version__,
    }
    for name in names:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = '-'
    return found
