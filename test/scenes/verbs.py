"""The verbs as a user types them, and what they answer."""

from __future__ import annotations

import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

from binopos_ros.cli import main

Done = subprocess.CompletedProcess[str]


def command(*words: object) -> list[str]:
    """A verb's command line, for a process of its own."""
    return [sys.executable, '-m', 'binopos_ros', *map(str, words)]


def binopos(*words: object, **options: Any) -> Done:
    """Run a verb in a process of its own; one that hangs is stopped."""
    return subprocess.run(
        command(*words), capture_output=True, text=True, check=False, timeout=300, **options
    )


def binopos_here(*words: object) -> Done:
    """Run a verb in this process, which saves its start."""
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        try:
            status = main([str(word) for word in words])
        except SystemExit as leaving:
            status = int(leaving.code or 0)
    return Done(list(words), status, out.getvalue(), err.getvalue())


def process(bag: Path, *words: object) -> Done:
    """Process a bag in this process; the output beside it replaces that of an earlier call."""
    out = bag.with_name('out.mcap')
    out.unlink(missing_ok=True)
    return binopos_here('process', bag, '-o', out, *words)


def simulated(bag: Path, preset: str, pairs: int) -> Path:
    """A bag by `binopos simulate`."""
    done = binopos('simulate', '-o', bag, '--preset', preset, '--pairs', pairs)
    assert done.returncode == 0, done.stderr
    return bag


def figure(done: Done, name: str) -> str:
    """What a verb's report says behind a name."""
    assert 'Traceback' not in done.stderr, done.stderr
    found = [
        line.split('  ')[-1].strip()
        for line in done.stdout.splitlines()
        if line.startswith(f'  {name} ')
    ]
    assert found, done.stdout + done.stderr
    return found[0]


def used(done: Done) -> int:
    """Pairs that gave a position."""
    return int(figure(done, 'pairs used'))


def refused(done: Done, *words: str) -> None:
    """Assert that a verb ended in one line with these words."""
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count('\n') == 1, done.stderr
    for word in words:
        assert word in done.stderr
