"""Find a water surface from what both cameras see of a board in the water."""

import numpy as np

from binopos_ros.calibration import Board, Media, View, calibrate_interface, guesses_from
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.optics.rig_state import RigState

camera = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], np.zeros(5), (1280, 960))
water = FlatInterface([0.01, -0.02, 1], 0.8, [1.0, 1.333])
rig = StereoRig(camera, camera, np.eye(3), [-0.23, 0, 0], water)

# In practice the pixels come from pictures: find_board(image, board).
board = Board('chessboard', 9, 6, 0.025)
random = np.random.default_rng(2)
views = []
for number in range(8):
    tilt = random.uniform(-0.5, 0.5, 2)
    turn = np.array([[1, 0, tilt[0]], [0, 1, tilt[1]], [-tilt[0], -tilt[1], 1]])
    turn, _ = np.linalg.qr(turn)
    turn *= np.sign(np.diag(turn))
    points = (board.points - board.points.mean(axis=0)) @ turn.T
    place = [*random.uniform(-0.08, 0.08, 2), random.uniform(1.0, 1.2)]
    pixels = rig.project(points + np.array(place))
    noisy = tuple(side + random.normal(0.0, 0.05, side.shape) for side in pixels)
    views.append(View(f'view {number}', board.points, noisy))

air = RigState.of(StereoRig(camera, camera, rig.rotation, rig.translation))
guesses = guesses_from(Media([1.0, 1.333], []), None, ['distance=0.75,0.1'])
found = calibrate_interface(air, views, guesses, None)
print(f'true  {water}')
print(f'found {found.state.interfaces["interface"]}')
