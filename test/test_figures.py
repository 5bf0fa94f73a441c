"""The documents hold the figures that the benches found, and those say what they were run on."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path
from types import ModuleType

import pytest

PROJECT = Path(__file__).resolve().parent.parent
KEPT = sorted((PROJECT / 'bench' / 'results').rglob('*.json'))


@pytest.fixture
def pages(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """`bench/pages.py`."""
    monkeypatch.syspath_prepend(str(PROJECT / 'bench'))
    return importlib.import_module('pages')


def test_the_documents_hold_what_the_benches_found(pages: ModuleType) -> None:
    for path in pages.documents():
        text = path.read_text(encoding='utf-8')
        assert pages.filled(text) == text, f'{path.name}: run python bench/pages.py'


def test_figures_of_another_form_are_refused(
    pages: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = {**json.loads(KEPT[0].read_text(encoding='utf-8')), 'form': pages.FORM - 1}
    (tmp_path / 'old.json').write_text(json.dumps(old), encoding='utf-8')
    monkeypatch.setattr(pages, 'RESULTS', tmp_path)
    for bench in ('old', 'missing'):
        with pytest.raises(pages.PageError, match=f'^{bench}: .* run the bench'):
            pages.filled(f'<!-- figures: {bench} any -->\n<!-- end of figures -->')


def test_what_is_kept_is_shown_and_has_its_bench(pages: ModuleType) -> None:
    shown = ''.join(path.read_text(encoding='utf-8') for path in pages.documents())
    for path in KEPT:
        bench = path.relative_to(pages.RESULTS).with_suffix('').as_posix()
        script = re.sub(r'\.[^/]*$', '', bench)
        assert (PROJECT / 'bench' / f'{script}.py').is_file(), bench
        assert f'<!-- figures: {bench} ' in shown, f'{bench} is in no document'


def test_what_is_kept_says_what_it_was_run_on_and_by_whom_it_is_beaten() -> None:
    for path in KEPT:
        kept = json.loads(path.read_text(encoding='utf-8'))
        assert re.fullmatch(r'[0-9a-f]{7,}\+?', kept['commit']), path.name
        assert set(kept['machine']) == {'processor', 'cores', 'load'}
        assert {'Python', 'numpy', 'OpenCV'} <= set(kept['versions'])
        assert all('losses' in table for table in kept['tables'].values())
        assert not re.search(r'/(?:root|work|home|tmp)/', path.read_text(encoding='utf-8'))


def test_a_peer_that_is_ahead_is_named_below_the_table(
    pages: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = importlib.import_module('figures')
    for module in (figures, pages):
        monkeypatch.setattr(module, 'RESULTS', tmp_path)
    found = figures.Figures('made', peers=('numpy',), rigs=3)
    column = figures.Column
    table = found.table('speeds', 'work', column('s', '.1f'), column('times theirs', '.2f', '<'))
    table.row('fast', [1.0, 2.0, 4.0, 8.0, 9.0], 3.0)
    table.row('slow', None, 0.93)
    table.row('theirs', 1.0, 0.5, compared=False)
    found.keep()
    page = pages.filled('<!-- figures: made speeds -->\n<!-- end of figures -->')
    assert '| fast | 4.0 (2.0 to 8.0) | 3.00 |\n| slow | - | 0.93 |\n' in page
    assert '\nLosses: slow: 0.93 (times theirs).\n' in page
    assert '*Rigs 3. Medians, with quartiles in brackets. ' in page
