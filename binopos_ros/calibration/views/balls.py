"""A known-size target as a view: what to calibrate an interface from when there is no board.

A small sphere (or a disc that faces the cameras) of known diameter is seen as a centre and an
apparent diameter. The view stands for them by four points of its outline, two along the picture's
u axis of which only u counts, two along v of which only v counts; each camera has its own four,
because each looks at another outline. Coordinates of standard deviation s so give the centre to
0.71 s and the diameter to s, the ratio in which the edge points of a blob give them.
"""

from __future__ import annotations

import numpy as np

from binopos_ros.calibration.views.targets import Blob
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import LEFT, RIGHT, RigState

CENTRE_PER_COORDINATE = 0.5**0.5  # of the standard deviations


def ball_view(name: str, state: RigState, blobs: tuple[Blob, Blob], diameter: float) -> View:
    """The view of a ball of known diameter (m) in both pictures."""
    points, pixels = [], [np.full((8, 2), np.nan), np.full((8, 2), np.nan)]
    for side in (LEFT, RIGHT):
        blob = blobs[side]
        camera = state.cameras[side]
        ray = camera.pinhole().unproject(np.asarray(blob.centre, float)[None])[0]
        to_rig = state.rotation.T if side == RIGHT else np.eye(3)
        half = 0.5 * blob.diameter
        pixels[side][4 * side : 4 * side + 2, 0] = blob.centre[0] + [half, -half]
        pixels[side][4 * side + 2 : 4 * side + 4, 1] = blob.centre[1] + [half, -half]
        for along in (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
            across = along - (along @ ray) * ray
            outwards = 0.5 * diameter * to_rig @ (across / np.linalg.norm(across))
            points += [outwards, -outwards]
    return View(name, np.array(points), (pixels[0], pixels[1]), turns=False)
