"""Cameras, their mutual pose and the interfaces before them, each with its uncertainty.

Three steps: `cameras` (`calibrate_stereo` takes what both cameras see of a board in air),
`interface` (`calibrate_interface` what they see through the surface or the ports), `check` (what
they see every day). They share what is seen (`views`), the `adjustment` and what is left behind
(`report`); `live` takes views from cameras that run.

>>> from binopos_ros.calibration import Board
>>> board = Board('chessboard', 9, 6, 0.025)
>>> print(board.points.shape, board.points.max(axis=0))
(54, 3) [0.2   0.125 0.   ]
"""

from __future__ import annotations

import importlib
from typing import Any

#: Public name -> where it lives. Imported when it is asked for: each step needs its own part.
FACE = {
    'Board': 'views.board',
    'BoardPair': 'views.pairs',
    'BoardView': 'views.corners',
    'CalibrationError': 'errors',
    'InterfaceCalibration': 'interface.calibrate',
    'Media': 'interface.priors',
    'StereoCalibration': 'cameras.stereo',
    'View': 'views.view',
    'calibrate_interface': 'interface.calibrate',
    'calibrate_stereo': 'cameras.stereo',
    'find_board': 'views.corners',
    'guesses_from': 'interface.priors',
    'read_stereo': 'report.files',
    'write_interface': 'report.files',
    'write_stereo': 'report.files',
}


def __getattr__(name: str) -> Any:
    if name not in FACE:
        msg = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(msg)
    return getattr(importlib.import_module(f'{__name__}.{FACE[name]}'), name)


def __dir__() -> list[str]:
    return sorted(FACE)
