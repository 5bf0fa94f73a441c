"""What the two cameras of a rig are called: in topics, in files, in parameters."""

from __future__ import annotations

LEFT, RIGHT = SIDES = ('left', 'right')
