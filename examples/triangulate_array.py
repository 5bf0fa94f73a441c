"""Many pairs of pixels to points, along rays that bend at the water's surface."""

import numpy as np

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation import triangulate

camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], np.zeros(5), (1280, 960))
water = FlatInterface(normal=[0, 0, 1], distance=0.8, indices=[1.0, 1.333])
rig = StereoRig(camera, camera, np.eye(3), [-0.23, 0, 0], water)

truth = np.random.default_rng(1).uniform([-0.2, -0.2, 1.0], [0.2, 0.2, 1.3], (1000, 3))
left, right = rig.project(truth)
found = triangulate(rig, left, right, left_cov=0.01 * np.eye(2), right_cov=0.01 * np.eye(2))
straight = triangulate(rig, left, right, method='straight')

print(f'bent rays:     {1000 * np.abs(found.points - truth).max():.6f} mm off at most')
print(f'straight rays: {1000 * np.abs(straight.points - truth).max():.0f} mm off at most')
deviations = 1000 * np.sqrt(np.diagonal(found.covariances, axis1=1, axis2=2)).mean(axis=0)
print(f'0.1 px make    {deviations.round(2)} mm (x, y, z)')
