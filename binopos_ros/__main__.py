"""`python -m binopos_ros`: the entry script `binopos`."""

from __future__ import annotations

import sys

from binopos_ros.cli import main

sys.exit(main())
