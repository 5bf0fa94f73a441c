"""Time per pair of putting a position into a fixed frame: samples taken in, pose, covariance.

python bench/platform/speed.py

An odometry or transforms at 50 Hz beside pairs at 30 Hz: each pair has five thirds of a sample to
bear. It is the processor's time, so that other work on the machine hardly counts.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))

import numpy as np

from binopos_ros.platform import FixedFrameOptions, Platform, PlatformOptions, WaitingRoom
from binopos_ros.simulation.rig_motion import (
    FIXED_FRAME,
    ROBOT_FRAME,
    Odometer,
    mounting,
    rig_motion,
)
from figures import Column, Figures

PAIRS = 3000
CAMERA, ROBOT = 30.0, 50.0
COVARIANCE = np.diag([1e-6, 1e-6, 9e-6])
POINT = np.array([0.1, 0.05, 1.5])


def main() -> None:
    """Print the table."""
    found = Figures('platform/speed')
    table = found.table('pairs', 'source', Column('a pair, us of the processor', '.0f'))
    for source in ('odometry', 'tf'):
        table.row(source, 1e6 * timed(source))
    found.keep()


def timed(source: str) -> np.ndarray:
    """(PAIRS,) seconds that each pair takes."""
    motion, odometer = rig_motion('hover', np.random.default_rng(1)), Odometer(rate=ROBOT)
    ticks = np.arange(-0.1, PAIRS / CAMERA + 0.2, 1 / ROBOT)
    samples = odometer.samples(motion, ticks, np.random.default_rng(2))
    options = PlatformOptions(source=source, mounting=mounting())
    platform = Platform(FixedFrameOptions(FIXED_FRAME, options))
    place = mounting()
    platform.tree.add(0, ROBOT_FRAME, 'left', place[:3], place[3:], static=True)
    room: WaitingRoom[None] = WaitingRoom(platform, 0.2)
    taken, sample = [], 0
    for pair in range(PAIRS):
        instant = pair / CAMERA
        stamp = round((1 + instant) * 1e9)
        began = time.process_time()
        room.add(None, stamp, 'left', instant)
        list(room.ready(instant))
        while ticks[sample] < instant + 1 / ROBOT:
            tick = round((1 + ticks[sample]) * 1e9)
            where, turn = samples[sample]
            if source == 'tf':
                platform.tree.add(tick, FIXED_FRAME, ROBOT_FRAME, where, turn)
            else:
                frames = FIXED_FRAME, ROBOT_FRAME
                platform.odometry.add(tick, *frames, where, turn, odometer.covariance)
            sample += 1
        for _, rig in room.ready(instant):
            assert not isinstance(rig, str), rig
            rig.carry(POINT, COVARIANCE)
        taken.append(time.process_time() - began)
    return np.array(taken)


if __name__ == '__main__':
    main()
