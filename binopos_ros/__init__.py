"""Stereo positioning of a red target through refracting media, live in ROS 2.

The rooms, in the order in which data flows: `capture`, `detection`, `triangulation`, `smoothing`;
`optics` underneath them, `calibration`, `simulation` and `bag` beside them. None of these knows
ROS. `nodes` is the thin ROS shell around them, and `cli` the entry script `binopos`.
"""

from typing import Any

__version__ = '0.1.0'


def __getattr__(name: str) -> Any:
    """Import the `Tracker` when it is asked for: the rooms alone do not need all of them."""
    if name == 'Tracker':
        from binopos_ros.tracker import Tracker

        return Tracker
    msg = f'module {__name__!r} has no attribute {name!r}'
    raise AttributeError(msg)
