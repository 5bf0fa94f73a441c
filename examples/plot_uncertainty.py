"""How sure a rig is of a position, by depth; a picture where matplotlib is installed."""

import sys

import numpy as np

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], np.zeros(5), (1280, 960))
water = FlatInterface([0, 0, 1], 0.8, [1.0, 1.333])
depths = np.linspace(0.85, 2.0, 24)
noise = 0.01 * np.eye(2)
curves = {}
for baseline in (0.1, 0.23, 0.4):
    rig = StereoRig(camera, camera, np.eye(3), [-baseline, 0, 0], water)
    points = np.column_stack([np.full(24, baseline / 2), np.zeros(24), depths])
    found = triangulate(rig, *rig.project(points), noise, noise)
    curves[baseline] = 1000 * np.sqrt(found.covariances[:, 2, 2])
for baseline, curve in curves.items():
    print(f'baseline {baseline:.2f} m: depth +- {curve[0]:.2f} mm near, {curve[-1]:.2f} mm far')

if len(sys.argv) > 1:
    from matplotlib import pyplot

    for baseline, curve in curves.items():
        pyplot.plot(depths, curve, label=f'baseline {baseline} m')
    pyplot.xlabel('distance (m)')
    pyplot.ylabel('standard deviation of depth (mm)')
    pyplot.legend()
    pyplot.savefig(sys.argv[1])
