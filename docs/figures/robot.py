"""Draw docs/figures/robot.png: what accuracy to expect from a hovering robot.

Run as `python docs/figures/robot.py`; a minute or two. A target at rest, 0.1 px of noise, ten
seconds at 30 Hz: its positions in the fixed frame and its pose, by range, for three odometries.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import matplotlib.pyplot as plt
import numpy as np

sys.path.append(str(Path(__file__).parents[2] / 'test' / 'scenes'))

from binopos_ros.simulation.rig_motion import Odometer
from hovering import hovering, rms

ODOMETERS = {
    '0.02 degree, 0.5 mm': Odometer(0.0005, float(np.deg2rad(0.02))),
    '0.1 degree, 2 mm': Odometer(0.002, float(np.deg2rad(0.1))),
    '0.5 degree, 10 mm': Odometer(0.01, float(np.deg2rad(0.5))),
}
RANGES = (0.5, 1.0, 1.5, 2.0, 3.0)
SEEDS = range(3)


def main() -> None:
    """Draw the panel."""
    figure, axes = plt.subplots(figsize=(9, 4), constrained_layout=True)
    for number, (name, odometer) in enumerate(ODOMETERS.items()):
        runs = [[hovering(each, 0.1, odometer, seed) for seed in SEEDS] for each in RANGES]
        for kind, style in (('raw', ':'), ('pose', '-')):
            errors = [
                1e3 * rms(np.concatenate([getattr(run, kind) for run in some])) for some in runs
            ]
            label = f'{name}: {"position" if kind == "raw" else "pose"}'
            axes.plot(RANGES, errors, f'C{number}{style}', label=label)
    axes.set(xlabel='range (m)', ylabel='RMS in the fixed frame (mm)', yscale='log')
    axes.grid(visible=True, which='both', alpha=0.3)
    axes.legend(
        title='odometry, from sample to sample',
        fontsize='small',
        loc='center left',
        bbox_to_anchor=(1.02, 0.5),
    )
    figure.savefig(Path(__file__).with_suffix('.png'), dpi=110)


if __name__ == '__main__':
    main()
