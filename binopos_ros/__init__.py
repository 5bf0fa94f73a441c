"""Stereo positioning of a red target through refracting media, live in ROS 2.

The rooms, in the order in which data flows: `capture`, `detection`, `triangulation`, `smoothing`;
`optics` underneath them, `calibration`, `simulation` and `bag` beside them. None of these knows
ROS. `nodes` is the thin ROS shell around them, and `cli` the entry script `binopos`.
"""

__version__ = '0.1.0'
