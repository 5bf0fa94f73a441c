"""A wheel in a clean environment elsewhere: the demo, process, the page, and the examples.

    make clean-install     minutes, most of them pip's

Nothing of this checkout is on the path of what runs: it works in a temporary folder, on what the
wheel holds, and on copies of the examples.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent
#: Seconds for one step.
PATIENCE = 600.0
PORT = 18087


def main() -> int:
    with tempfile.TemporaryDirectory() as name:
        return check(Path(name))


def check(folder: Path) -> int:
    """Build, install and run everything; 1 if something fails."""
    environment = {k: v for k, v in os.environ.items() if k not in ('PYTHONPATH', 'VIRTUAL_ENV')}
    environment |= {'ROS_DOMAIN_ID': '87', 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}

    def run(name: str, *words: object) -> bool:
        began = time.monotonic()
        done = subprocess.run(
            [str(word) for word in words],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=PATIENCE,
        )
        well = done.returncode == 0
        print(
            f'{"ok  " if well else "FAIL"} {time.monotonic() - began:6.1f} s  {name}', flush=True
        )
        if not well:
            print(done.stdout[-1500:] + done.stderr[-1500:])
        return well

    source = folder / 'source'
    tracked = subprocess.run(
        ['git', 'ls-files', '-z'], cwd=PROJECT, capture_output=True, text=True, check=True
    ).stdout.split('\0')
    for each in filter(None, tracked):
        (source / each).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(PROJECT / each, source / each)
    run(
        'wheel of the tracked files',
        *(sys.executable, '-m', 'pip', 'wheel', '--quiet', '--no-deps', '--no-build-isolation'),
        *('-w', folder, source),
    )
    (wheel,) = folder.glob('*.whl')
    shutil.rmtree(source)
    shutil.copytree(PROJECT / 'examples', folder / 'examples')
    shutil.copytree(PROJECT / 'bags', folder / 'bags')
    clean = folder / 'clean'
    steps = [
        run('environment', sys.executable, '-m', 'venv', clean),
        run(
            'wheel installed with ROS',
            *(clean / 'bin' / 'pip', 'install', '--quiet', f'{wheel}[ros,reports]'),
        ),
    ]
    binopos, python = clean / 'bin' / 'binopos', clean / 'bin' / 'python'
    demo = clean / 'share' / 'binopos_ros' / 'bags' / 'demo'
    steps += [
        run('binopos --version', binopos, '--version'),
        run('binopos replay --demo', binopos, 'replay', '--demo'),
        run('binopos process', binopos, 'process', demo, '-o', 'out.mcap', '--csv', 'out.csv'),
        run('binopos report', binopos, 'report', 'out.mcap', demo, '-o', 'dive.html'),
        served(binopos, demo, folder, environment),
    ]
    for path in sorted((folder / 'examples').glob('*.py')):
        # The subscriber waits for nodes; test/nodes/test_example_listener.py has them.
        if path.stem != 'subscribe_pose':
            steps.append(run(f'examples/{path.name}', python, path))
    print(f'{sum(steps)} of {len(steps)} steps are well')
    return int(not all(steps))


def served(binopos: Path, bag: Path, folder: Path, environment: dict[str, str]) -> bool:
    """Whether `binopos view` serves its page on the bag, and ends when it is told to."""
    process = subprocess.Popen(
        [str(binopos), 'view', str(bag), '--port', str(PORT)],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    told, page = '', ''
    for line in process.stdout:
        told += line
        if 'http://' in line:
            address = next(word for word in line.split() if word.startswith('http://'))
            try:
                with urllib.request.urlopen(address, timeout=60) as answer:
                    page = answer.read().decode()
            except urllib.error.URLError as error:
                told += str(error)
            break
    process.terminate()
    told += process.communicate(timeout=60)[0]
    # Ended by the signal itself, or in good order because of it.
    well = '<html' in page.lower() and process.returncode in (0, -signal.SIGTERM)
    print(f'{"ok  " if well else "FAIL"}           binopos view{"" if well else told}', flush=True)
    return well


if __name__ == '__main__':
    raise SystemExit(main())
