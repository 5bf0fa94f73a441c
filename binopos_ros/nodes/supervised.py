"""What a node does for its supervisor: it ends with it, and it ends quietly.

Imported before anything that takes time, so that a signal during start-up leaves no traceback.
"""

from __future__ import annotations

import ctypes
import os
import signal
from pathlib import Path

#: Environment variable that a supervisor sets for its children.
SUPERVISED = 'BINOPOS_SUPERVISED'
PR_SET_PDEATHSIG = 1
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
