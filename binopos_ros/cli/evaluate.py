"""`binopos evaluate`: the paper's experiments, and the comparison of filters."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import Any

from binopos_ros.cli.config import add_config_argument, parameters_of
from binopos_ros.cli.progress import progress
from binopos_ros.cli.provenance import how_made
from binopos_ros.evaluation import QUICK, Results, Settings, Store, evaluate, tables
from binopos_ros.evaluation.figures import Figure, figures
from binopos_ros.evaluation.page import as_text, write_csv, write_page
from binopos_ros.parameters import specs_of
from binopos_ros.smoothing.stage import SmootherOptions, filter_options_type

EPILOG = """\
examples:
  binopos evaluate --quick           a minute's version
  binopos evaluate -o evaluation     100 experiments of each kind, 200 sequences

Results are kept in the folder part by part: a run that was stopped goes on
where it was, and a second one only writes the report. A part is made anew when
what it depends on has changed. What --config and -p give the smoother holds for
its filter in the comparison, in the place of the tuned values.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = EPILOG
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('evaluation'),
        metavar='DIR',
        help='folder for the report (evaluation.html), the tables as CSV and the parts '
        '(default: evaluation)',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help=f'{QUICK.experiments} experiments of each kind and {QUICK.sequences} sequences',
    )
    parser.add_argument(
        '--experiments', type=int, metavar='N', help='of each of the three kinds (default: 100)'
    )
    parser.add_argument(
        '--sequences', type=int, metavar='N', help='to compare the filters on (default: 200)'
    )
    parser.add_argument(
        '--pixel-std',
        type=float,
        metavar='PX',
        help="noise of the target's centre in each picture, px (default: 0.05)",
    )
    parser.add_argument('--seed', type=int, metavar='S', help='default: 2018')
    add_config_argument(parser)


def main(arguments: argparse.Namespace) -> int:
    chosen = {
        name: getattr(arguments, name)
        for name in ('experiments', 'sequences', 'pixel_std', 'seed')
        if getattr(arguments, name) is not None
    }
    settings = dataclasses.replace(QUICK if arguments.quick else Settings(), **chosen)
    tried = _tried(arguments)
    results = evaluate(settings, Store(arguments.output / 'parts'), progress, tried)
    made = tables(results)
    write_csv(arguments.output, made)
    how = how_made(arguments, arguments.config)
    how = how._replace(inputs=[f'simulated, with {settings}', *how.inputs])
    page = write_page(arguments.output, settings, made, _pictures(results), how)
    for table in made:
        print(f'{as_text(table)}\n')
    print(f'{page}: tables and pictures; the tables are beside it as CSV')
    return 0


def _tried(arguments: argparse.Namespace) -> dict[str, dict[str, Any]]:
    """The smoother's own parameters, as those of its filter in the comparison."""
    values = parameters_of(arguments).of_node('smoother')
    method = values.get('method') or specs_of(SmootherOptions)['method'].default
    own = specs_of(filter_options_type(method))
    given = {name: value for name, value in values.items() if name in own and value is not None}
    return {method: given} if given else {}


def _pictures(results: Results) -> list[Figure]:
    try:
        return figures(results)
    except ImportError:
        print(
            'binopos evaluate: no pictures, as matplotlib is missing: pip install matplotlib',
            file=sys.stderr,
        )
        return []
