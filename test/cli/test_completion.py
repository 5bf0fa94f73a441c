"""Tab in bash completes verbs and options, as docs/operation.md sets it up."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

#: Seconds after which a shell that says nothing has failed.
PATIENCE = 120.0
SETUP = 'eval "$(register-python-argcomplete binopos)"'


class Shell:
    """An interactive bash with the environment's programs on its path."""

    def __init__(self, folder: Path) -> None:
        self._ours, theirs = pty.openpty()
        environment = {
            **os.environ,
            'PATH': f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}',
            'PS1': '$ ',
            'TERM': 'dumb',
        }
        self._bash = subprocess.Popen(
            ['bash', '--norc', '--noprofile', '-i'],
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            cwd=folder,
            env=environment,
            start_new_session=True,
        )
        os.close(theirs)
        self.text = ''

    def send(self, keys: str) -> None:
        """Type."""
        os.write(self._ours, keys.encode())

    def until(self, pattern: str) -> str:
        """Read until the screen has what is looked for; what it matched. The screen is wiped."""
        while (found := re.search(pattern, self.text)) is None:
            ready, _, _ = select.select([self._ours], [], [], PATIENCE)
            assert ready, f'no {pattern!r} in {self.text!r}'
            self.text += os.read(self._ours, 4096).decode(errors='replace')
        self.text = ''
        return found[0]

    def close(self) -> None:
        """Hang up."""
        self._bash.kill()
        self._bash.wait()
        os.close(self._ours)


@pytest.mark.skipif(shutil.which('bash') is None, reason='there is no bash')
def test_tab_completes_verbs_options_and_files_in_bash(tmp_path: Path) -> None:
    pytest.importorskip('argcomplete', reason='argcomplete is not installed')
    (tmp_path / 'evening.mcap').touch()
    shell = Shell(tmp_path)
    try:
        shell.send(f'{SETUP}; echo set "up"\n')
        shell.until('set up')
        shell.send('binopos proc\t')
        shell.until('binopos process ')
        shell.send('even\t')
        shell.until(r'evening\.mcap ')
        shell.send('--csv-a\t')
        shell.until('--csv-all ')
    finally:
        shell.close()
