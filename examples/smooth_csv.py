"""Smooth the raw positions of a table that `binopos process --csv` wrote."""

import csv
import sys
from pathlib import Path

import numpy as np

from binopos_ros.smoothing import smooth

TABLE = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parent / 'positions.csv')
COVARIANCE = np.diag([1e-4, 1e-4, 5e-4]) ** 2  # of a raw position, m^2

rows = list(csv.DictReader(TABLE.open()))
stamps = [float(row['stamp']) for row in rows]
raw = [[float(row[f'raw_{axis}']) for axis in 'xyz'] for row in rows]
found = smooth(stamps, raw, COVARIANCE)
tracks = raw, found.positions
steps = [1000 * np.abs(np.diff(track, n=2, axis=0)[20:, 2]).mean() for track in tracks]
print(f'{len(raw)} positions; depth jitters by {steps[0]:.2f} mm raw, {steps[1]:.2f} mm smoothed')
place, speed = found.positions[-1].round(3), found.velocities[-1].round(2)
print(f'at the end {place} m, velocity {speed} m/s')
