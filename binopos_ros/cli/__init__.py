"""`binopos`, the entry script: one verb, one module.

A verb's module has `add_arguments(parser)` and `main(arguments) -> exit status`.
Modules are imported only when their verb is called, so that `binopos --help` needs no ROS.
"""

from __future__ import annotations

import gc
import importlib
import os
import shlex
import sys
from collections.abc import Sequence
from typing import Any

from binopos_ros import __version__
from binopos_ros.cli.completion import asked_verb, complete
from binopos_ros.cli.leftovers import clear_leftovers
from binopos_ros.cli.parser import VerbParser, split_ros_arguments

#: Verb -> what it does, in the order of the help.
VERBS = {
    'run': 'start the nodes on the cameras of the rig and keep them up',
    'replay': 'play a bag through the live nodes and report what comes out',
    'process': 'run a bag through the same stages offline, every pair, as fast as possible',
    'view': "serve the operator's page: what the rig sees and what is wrong, in a browser",
    'report': 'write one page about a dive: its path, how sure it is, what happened',
    'record': "record the suite's topics to a bag",
    'simulate': 'render a scene with known truth to a bag',
    'calibrate': 'make the calibration files of the cameras and of the interface',
    'evaluate': "the paper's experiments and the comparison of filters: tables and plots",
    'doctor': 'say what is wrong with this machine, and how to mend it',
}

USAGE_ERROR = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; the exit status. Bad input is one line on stderr and status 2."""
    try:
        return _run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        # Also while a verb's modules are imported, which may take a second.
        return 130


def _run(arguments: Sequence[str]) -> int:
    words, ros_words = split_ros_arguments(arguments)
    parser = VerbParser(
        prog='binopos',
        description='Stereo positioning of a red target through water or glass.',
        epilog='`binopos VERB --help` tells more about a verb.',
    )
    parser.add_argument('--version', action='version', version=f'binopos_ros {__version__}')
    verbs = parser.add_subparsers(dest='verb', metavar='VERB', required=True)
    for verb, help_line in VERBS.items():
        verb_parser = verbs.add_parser(verb, help=help_line, description=help_line + '.')
        # Only the verb that was asked for is imported.
        if verb in (*words[:1], asked_verb(os.environ)):
            _module_of(verb).add_arguments(verb_parser)
    complete(parser)
    parsed = parser.parse_args(words)
    parsed.ros_arguments = ros_words
    parsed.command = shlex.join(['binopos', *arguments])
    clear_leftovers()
    try:
        return int(_module_of(parsed.verb).main(parsed))
    except BrokenPipeError:
        # The reader of our output has gone; so does the rest of the output.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (ValueError, OSError, RuntimeError) as error:
        print(f'binopos {parsed.verb}: {" ".join(str(error).split())}', file=sys.stderr)
        return USAGE_ERROR


def _module_of(verb: str) -> Any:
    """The verb's module; what comes with it stays, so that no garbage is looked for meanwhile."""
    gc.disable()
    try:
        return importlib.import_module(f'binopos_ros.cli.{verb}')
    finally:
        gc.enable()
