"""What a node does for its supervisor: it ends with it, and it ends quietly.

Imported before anything that takes time, so that a signal during start-up leaves no traceback.
"""

from __future__ import annotations

import ctypes
import os
import signal

#: Environment variable that a supervisor sets for its children.
SUPERVISED = 'BINOPOS_SUPERVISED'
PR_SET_PDEATHSIG = 1


def prepare() -> None:
    """Leave quietly on a signal while ROS is not up yet; die with a supervisor that is killed."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # Not SystemExit: raised inside an import, it comes out as an ImportError with a traceback.
        signal.signal(number, lambda *_: os._exit(0))
    if os.environ.get(SUPERVISED):
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
