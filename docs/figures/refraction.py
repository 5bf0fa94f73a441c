"""Draw docs/figures/refraction.png: what straight rays cost, and what the pixels can tell.

Run as `python docs/figures/refraction.py`. The rig is the paper's (230 mm apart, 0.8 m above
water, f = 900 px); the target moves sideways from below the left camera.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use('Agg')

import matplotlib.pyplot as plt
import numpy as np

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

WATER = 1.333
NOISE = 0.01 * np.eye(2)  # px^2


def washbowl() -> StereoRig:
    """Return the paper's rig."""
    camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], (), (1280, 960))
    surface = FlatInterface((0, 0, 1), 0.8, (1.0, WATER))
    return StereoRig(camera, camera, np.eye(3), (-0.23, 0, 0), surface)


def main() -> None:
    """Draw both panels."""
    rig = washbowl()
    figure, (cost, limit) = plt.subplots(1, 2, figsize=(10, 3.8), constrained_layout=True)
    for depth in (0.05, 0.2, 0.5):
        aside = np.linspace(0.0, 2.0, 80)
        points = np.column_stack([aside, 0 * aside, 0.8 + depth + 0 * aside])
        left, right = rig.project(points)
        incidence = np.degrees(np.arccos(rig.left.unproject(left)[:, 2]))
        straight = triangulate(rig, left, right, method='straight').points
        cost.plot(incidence, 1e3 * np.linalg.norm(straight - points, axis=1), label=f'{depth} m')
    cost.set(
        xlabel='angle of incidence, left camera (degrees)', ylabel='error of straight rays (mm)'
    )
    cost.legend(title='under water')

    depths = np.linspace(0.01, 1.0, 60)
    points = np.column_stack([0 * depths + 0.3, 0 * depths + 0.1, 0.8 + depths])
    left, right = rig.project(points)
    names = rig.parameter_names
    std = np.array([0.003 if name == 'target_index' else 0.0 for name in names])
    known = triangulate(rig, left, right, NOISE, NOISE)
    unsure = triangulate(rig, left, right, NOISE, NOISE, parameter_covariance=np.diag(std * std))
    for found, style, label in (
        (known, '-', 'index known'),
        (unsure, '--', 'index known to 0.003'),
    ):
        sigma = 1e3 * np.sqrt(np.diagonal(found.covariances, axis1=1, axis2=2))
        limit.plot(depths, sigma[:, 2], 'C0' + style, label=f'along the normal, {label}')
        limit.plot(depths, sigma[:, 0], 'C1' + style, label=f'across it, {label}')
    limit.set(xlabel='depth under water (m)', ylabel='standard deviation at 0.1 px (mm)')
    limit.legend(fontsize='small')
    figure.savefig(Path(__file__).with_name('refraction.png'), dpi=90)


if __name__ == '__main__':
    main()
