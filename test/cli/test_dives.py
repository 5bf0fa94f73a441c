"""`binopos process` on many bags: what each gives alone, and one summary."""

from __future__ import annotations

import argparse
import functools
import operator
import os
import sys
from collections import Counter
from pathlib import Path

import pytest

from binopos_ros.cli.dives import Outcome, process_all, summary
from binopos_ros.cli.terminal import fitted
from verbs import binopos, simulated


@pytest.fixture(scope='module')
def dives(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two bags of a few pairs."""
    folder = tmp_path_factory.mktemp('dives')
    return [
        simulated(folder / name, 'washbowl', pairs) for name, pairs in (('one', 4), ('two', 6))
    ]


def test_each_bag_gives_what_it_gives_alone_and_there_is_one_summary(dives, tmp_path):
    broken = tmp_path / 'broken.mcap'
    broken.write_bytes(b'no bag')
    together = tmp_path / 'together'
    done = binopos('process', *dives, broken, '--jobs', 2, '-o', together, '--csv', together)
    assert done.returncode == 2
    lines = [' '.join(line.split()) for line in done.stdout.splitlines()]
    assert lines[:2] == [f'{dives[0]} 4 poses of 4 pairs', f'{dives[1]} 6 poses of 6 pairs']
    assert lines[2].startswith(f'{broken} ')
    assert 'broken.mcap' in lines[2].removeprefix(f'{broken} ')
    assert lines[3:] == [
        'bags 3, 1 of them could not be processed',
        'pairs seen 10',
        'poses 10',
    ]
    # On a slow machine it tells how far it is.
    assert all(line.startswith('bags: ') for line in done.stderr.splitlines())
    assert sorted(each.name for each in together.iterdir()) == [
        *('one.csv', 'one.mcap', 'two.csv', 'two.mcap')
    ]
    for bag in dives:
        alone, table = tmp_path / f'{bag.name}.mcap', tmp_path / f'{bag.name}.csv'
        assert binopos('process', bag, '-o', alone, '--csv', table).returncode == 0
        assert table.read_bytes() == (together / f'{bag.name}.csv').read_bytes()
        assert alone.read_bytes() == (together / f'{bag.name}.mcap').read_bytes()


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (
            ('a/dive', 'b/dive', '-o', 'out'),
            'a/dive and b/dive would both be written to dive.mcap',
        ),
        (('a/dive', 'b/other', '-o', 'out.mcap'), 'out.mcap is no folder'),
        (('a/dive', '--jobs', '2', '-o', 'out', '--csv', 'out.csv'), 'out.csv is no folder'),
    ],
)
def test_outputs_that_would_collide_are_refused_in_a_line(words, told, tmp_path):
    done = binopos('process', *words)
    assert (done.returncode, done.stdout) == (2, '')
    assert told in done.stderr
    assert done.stderr.count('\n') == 1


def test_a_process_that_ends_costs_only_its_bag(capsys, tmp_path):
    arguments = argparse.Namespace(
        bags=[Path('dive'), Path('other')], output=tmp_path, csv=None, jobs=2
    )
    arguments.end = functools.partial(os._exit, 9)
    assert process_all(operator.methodcaller('end'), arguments) == 2
    assert capsys.readouterr().out.count('its process ended with status 9') == 2


def test_the_summary_fits_a_terminal_of_80_columns(monkeypatch):
    monkeypatch.setattr(sys.stdout, 'isatty', lambda: True, raising=False)
    monkeypatch.setenv('COLUMNS', '80')
    bags = [Path('dives', 'a' * 60), Path('dives', 'short')]
    drops = Counter({'the rays miss each other by more than their noise can tell': 12})
    outcomes = [Outcome.failed('no bag, ' + 'and a word more ' * 8), Outcome(300, 288, drops)]
    lines = fitted(summary(bags, outcomes)).splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.split()[-5:] == ['288', 'poses', 'of', '300', 'pairs'] for line in lines)
