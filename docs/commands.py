"""Runs the commands that the documents show, as they stand there: `make docs-commands`.

    python docs/commands.py [--pairs N] [PAGE ...]   minutes; all pages unless some are named

Each page has a folder of its own, in which its commands follow each other as on the page. What a
reader brings (a bag, a board's pictures) is rendered first. Lines that cannot be run are named
with the reason. `test/test_docs_commands.py` holds that every line of every document is one or the
other, and runs a short page.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

PROJECT = Path(__file__).resolve().parent.parent
DOCUMENTS = sorted(
    path for folder in ('.', 'docs', 'bags', 'examples') for path in PROJECT.glob(f'{folder}/*.md')
)
PROGRAMS = ('apt', 'binopos', 'chrt', 'docker', 'make', 'pip', 'pytest', 'python', 'ros2', 'sudo')

BOARD_IN_WATER = 'simulate -o wet --board 9x6 --square 0.02 --pairs 15 --rate 2 --seed 2'


class Page(NamedTuple):
    """What a page's commands need: verbs before the first, and words that stand for others."""

    before: tuple[str, ...] = ()
    words: Mapping[str, str] = MappingProxyType({})


PAGES = {
    'README.md': Page(),
    'docs/calibration.md': Page(
        before=(
            'simulate -o dry --board 9x6 --square 0.02 --air --pairs 25 --rate 2',
            BOARD_IN_WATER,
            'simulate -o disc --pairs 30',
            'calibrate convert dry -o camchain.yaml --to kalibr',
            f'{BOARD_IN_WATER.replace("wet", "wet-domes")} --preset domes',
            f'{BOARD_IN_WATER.replace("wet", "wet-ports")} --preset ports',
        ),
        words={
            r'stereo PICTURES': 'stereo dry',
            r'interface PICTURES': 'interface wet',
            r'check BAG': 'check disc',
            r'wet (.*)--calibration calibration (.*--shape dome)': (
                r'wet-domes \1--calibration wet-domes -o domes \2'
            ),
            r'wet (.*)--calibration calibration (.*--ports --indices 1\.0,1\.47,1\.333)': (
                r'wet-ports \1--calibration wet-ports -o ports \2'
            ),
            # Beside what came of the lines before, which these would not write over.
            r'camchain\.yaml -o calibration': 'camchain.yaml -o converted',
            # What OpenCV finds has five terms; these cameras have none.
            r'calibration -o camchain\.yaml': 'dry -o again.yaml',
            r'-o (dry|wet) (.*--pairs (?:100|40))': r'-o \1-large \2',
            r'calibrate stereo dry --square 0\.05': 'calibrate stereo dry-large --square 0.05',
            r'interface wet --square 0\.03': 'interface wet-large --square 0.03',
        },
    ),
    'docs/dives.md': Page(
        before=('simulate -o dives/one --pairs 4', 'simulate -o dives/two --pairs 6'),
        words={'my_rig.yaml': 'dives/one/binopos.yaml'},
    ),
    'docs/domes.md': Page(
        before=(f'{BOARD_IN_WATER.replace("wet", "seen")} --preset domes',),
        words={r'wet (.*)--calibration calibration': r'seen \1--calibration seen -o first'},
    ),
    'docs/pool.md': Page(),
    'docs/simulation.md': Page(),
    'docs/tutorial.md': Page(),
}

#: Lines that are not run here, and why.
NOT_RUN = {
    r'sudo|pip install|docker|ros2 (?!security)': 'it needs ROS of apt, or changes the machine',
    r'ros2 security': 'SROS 2 is in no wheel; test/nodes/test_policy.py reads the policy',
    r'binopos (run|record) .*--enclave': 'it needs the keystore of `ros2 security`',
    r'binopos run': 'it needs cameras: test/camera_lab runs it on the drivers of the kernel',
    r'binopos record': 'nobody publishes: test/cli/test_record.py',
    r'make (demo|test)': 'it sets up an environment; CI runs `make test`',
    r'chrt|python (bench|docs/figures)/': 'it measures: bench/results, or the figure beside it',
    r'binopos calibrate stereo --live': 'it waits: test/calibration/test_live_node.py',
    r'binopos view': 'it serves until it is ended: test/nodes/test_viewer.py',
    r'binopos evaluate': 'it takes minutes: test/evaluation runs it with fewer sequences',
    r'binopos process .*(--left|--side-by-side|--namespace|--remap) /': (
        'such bags are made by test/cli/test_other_bags.py and test_other_topics.py'
    ),
    r'binopos calibrate interface bag --calibration calibration --target-diameter': (
        'test/calibration/test_verb.py makes such a bag'
    ),
    r'.*--surface-indices': 'a housing before a wall: test/calibration/test_verb.py',
    r'.*interface wet/left --side left': 'one housing alone: test/calibration/test_verb.py',
    r'.*interface tank ': 'a tank from outside: test/calibration/test_interface_alone.py',
    r'.*convert intrinsics\.yml extrinsics\.yml': 'test/optics/test_peoples_files.py has them',
}


def lines(path: Path) -> list[str]:
    """Return the commands in a document's code blocks, continued lines joined."""
    text = re.sub(r'\\\n\s*', ' ', path.read_text(encoding='utf-8'))
    blocks = re.findall(r'^```(?:sh|bash|console)?\n(.*?)^```', text, re.MULTILINE | re.DOTALL)
    blocks += re.findall(r'^((?:    .*\n)+)', text, re.MULTILINE)
    found = [line.strip().removeprefix('$ ') for block in blocks for line in block.splitlines()]
    return [line for line in found if line.partition(' ')[0] in PROGRAMS and ' ' in line]


def reason(line: str) -> str:
    """Return why a line is not run, '' for one that is."""
    return next((why for pattern, why in NOT_RUN.items() if re.match(pattern, line)), '')


def commands(name: str, pairs: int = 0) -> Iterator[tuple[str, str]]:
    """Return each line of a page that is run, and what is run for it.

    With `pairs` no bag is longer: the tests have little time.
    """
    page = PAGES[name]
    shown = [line for line in lines(PROJECT / name) if not reason(line)]
    for line in [*(f'binopos {each}' for each in page.before), *shown]:
        run = line.partition(' #')[0].strip()
        for word, instead in page.words.items():
            run = re.sub(word, instead, run)
        if pairs and ' simulate ' in run:
            run = f'{re.sub(r" --pairs [0-9]+", "", run)} --pairs {pairs}'
        yield line, run


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--pairs', type=int, default=0, help='in each bag, for a quicker run')
    parser.add_argument('pages', nargs='*', metavar='PAGE', default=list(PAGES))
    arguments = parser.parse_args()
    binopos = Path(sys.executable).with_name('binopos')
    failed = 0
    for name in arguments.pages:
        with tempfile.TemporaryDirectory() as folder:
            print(name)
            for _, run in commands(name, arguments.pairs):
                begun = time.monotonic()
                # By a shell, as a reader's: it expands what has a star.
                done = subprocess.run(
                    ['sh', '-c', f'"$0" {run.removeprefix("binopos ")}', str(binopos)],
                    cwd=folder,
                    capture_output=True,
                    text=True,
                    check=False,
                )
                failed += done.returncode != 0
                print(f'  {time.monotonic() - begun:5.1f} s  {done.returncode}  {run}', flush=True)
                if done.returncode:
                    print(done.stdout[-800:], done.stderr[-800:])
    print(f'{failed} of the commands failed')
    return int(failed > 0)


if __name__ == '__main__':
    raise SystemExit(main())
