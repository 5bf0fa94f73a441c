"""Smooth the raw positions of a table that `binopos process --csv` wrote."""

import csv
import sys
from pathlib import Path

import numpy as np

from binopos_ros.smoothing import make_filter

TABLE = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / 'positions.csv')
COVARIANCE = np.diag([1e-4, 1e-4, 5e-4]) ** 2  # of a raw position, m^2

smoother = make_filter('cloud-kalman')
raw, smooth = [], []
for row in csv.DictReader(TABLE.open()):
    position = [float(row[f'raw_{axis}']) for axis in 'xyz']
    state = smoother.step(float(row['stamp']), position, COVARIANCE)
    raw.append(position)
    smooth.append(state.position)
steps = [1000 * np.abs(np.diff(track, n=2, axis=0)[20:, 2]).mean() for track in (raw, smooth)]
print(f'{len(raw)} positions; depth jitters by {steps[0]:.2f} mm raw, {steps[1]:.2f} mm smoothed')
print(f'at the end {np.round(smooth[-1], 3)} m, velocity {np.round(state.velocity, 2)} m/s')
