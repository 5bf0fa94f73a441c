"""How near triangulation comes to the Cramer-Rao bound of its pixels, over rigs of every kind.

Run as `python bench/triangulation/bound.py [--points N]`. Random points, pixel noise of about
0.1 px.

bound    RMS over the points of the bound's 3-D standard deviation (projection differenced), mm
RMS      of the 3-D error over the bound's
NSE      mean normalised squared error: 3 for a covariance that is honest
straight RMS 3-D error of straight rays, as if there were no surface, mm
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'test' / 'scenes'))

import numpy as np

import every_rig
from binopos_ros.triangulation import triangulate
from figures import Column, Figures

LEFT = np.array([[0.010, 0.004], [0.004, 0.020]])  # px^2
POINTS = 10_000
RIGHT = np.array([[0.015, -0.006], [-0.006, 0.008]])


def main() -> None:
    """Print one line per rig."""
    parser = argparse.ArgumentParser(description='Triangulation against the Cramer-Rao bound.')
    parser.add_argument('--points', type=int, default=POINTS)
    count = parser.parse_args().points
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.25, -0.25, 1.0], [0.4, 0.25, 1.6], (count, 3))
    kept = Figures('triangulation/bound')
    table = kept.table(
        'rigs',
        'rig',
        Column('bound, mm', '.3f'),
        Column('RMS', '.4f'),
        Column('NSE', '.3f'),
        Column('straight, mm', '.1f'),
    )
    for name, rig in every_rig.RIGS.items():
        left, right = rig.project(points)
        left = left + rng.standard_normal(left.shape) @ np.linalg.cholesky(LEFT).T
        right = right + rng.standard_normal(right.shape) @ np.linalg.cholesky(RIGHT).T
        found = triangulate(rig, left, right, LEFT, RIGHT)
        errors = found.points - points
        best = every_rig.inverse_information(rig, points, LEFT, RIGHT)
        bound = np.sqrt(np.trace(best, axis1=1, axis2=2).mean())
        rms = np.sqrt((errors**2).sum(axis=1).mean())
        squared = np.linalg.solve(found.covariances, errors[:, :, None])[:, :, 0]
        straight = triangulate(rig, left, right, LEFT, RIGHT, method='straight').points - points
        naive = np.sqrt(np.nanmean((straight**2).sum(axis=1)))
        square = (errors * squared).sum(axis=1).mean()
        table.row(name, 1e3 * bound, rms / bound, square, 1e3 * naive)
    if count == POINTS:
        kept.keep()


if __name__ == '__main__':
    main()
