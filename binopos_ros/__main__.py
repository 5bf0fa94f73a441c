"""`python -m binopos_ros`: the entry script `binopos`."""

from __future__ import annotations

import os
import sys

# With -m, Python looks for modules in the working folder first: whatever lies there would run.
# From here on what is installed is found, and this package wherever it is.
if sys.path[0] == os.getcwd():
    sys.path[:1] = []
    sys.path.append(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

from binopos_ros.cli import main

sys.exit(main())
