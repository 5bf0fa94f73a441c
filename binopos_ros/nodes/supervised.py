"""What a node does for its supervisor: it ends with it, and it ends quietly.

Imported before anything that takes time, so that a signal during start-up leaves no traceback.
"""

from __future__ import annotations

import ctypes
import os
import signal
import time
from pathlib import Path

#: Environment variable in which a supervisor gives its children its process id.
SUPERVISED = 'BINOPOS_SUPERVISED'
#: Environment variable with the descriptor of the pipe that a node beats into.
HEARTBEAT = 'BINOPOS_HEARTBEAT'
#: Seconds between beats.
BEAT_PERIOD = 0.2
PR_SET_PDEATHSIG = 1
PR_SET_NAME = 15
#: The file that Python starts for nodes. As `-m binopos_ros.nodes` it would find modules in the
#: working folder before its own.
STARTER = str(Path(__file__).with_name('__main__.py'))


def is_supervised() -> bool:
    """Whether this process is a node that a verb has started, and has told about already."""
    return bool(os.environ.get(SUPERVISED))


def prepare() -> None:
    """Leave quietly on a signal while ROS is not up yet; die with a supervisor that is killed."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # Not SystemExit: raised inside an import, it comes out as an ImportError with a traceback.
        signal.signal(number, lambda *_: os._exit(0))
    if is_supervised():
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if str(os.getppid()) != os.environ[SUPERVISED]:
            # Killed while this process was starting up: no signal comes for that any more.
            os._exit(0)


class Heart:
    """Tells the supervisor that this process is alive, as often as it is called and no more."""

    def __init__(self) -> None:
        self._pipe = os.environ.get(HEARTBEAT, '')
        self._next = 0.0

    def beat(self) -> None:
        """Beat, if a supervisor listens and the last beat is long enough ago."""
        now = time.monotonic()
        if not self._pipe or now < self._next:
            return
        self._next = now + BEAT_PERIOD
        try:
            os.write(int(self._pipe), b'.')
        except OSError:
            # Nobody has listened for long: the pipe is full, or closed.
            return


def bear_name(name: str) -> None:
    """Let `ps` and `top` show this process by the name of its node."""
    ctypes.CDLL(None).prctl(PR_SET_NAME, name.encode())
