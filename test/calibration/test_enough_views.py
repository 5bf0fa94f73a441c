"""How many pictures are enough, at full size: the corners of the simulator's boards, traced.

The corners are traced by the simulator instead of found in its pictures, which take minutes to
render; what pictures add, noise, is that of rendered ones.
"""

from __future__ import annotations

import numpy as np

from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.interface.guesses import InterfaceGuess
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.optics import StereoRig
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.simulation.boards import ShownBoard
from binopos_ros.simulation.presets import Choices, in_air, washbowl, with_board
from binopos_ros.simulation.scene import Scene
from binopos_ros.triangulation import triangulate

SIZES = ((1280, 960), (1280, 960))
#: What `calibrate` finds of the corners in rendered pictures, and the detector of their target.
CORNER_NOISE, CENTRE_NOISE = 0.03, 0.014  # px


def boards_of(scene: Scene, board: Board, count: int, seed: int) -> list[BoardPair]:
    """What perfect corner finders see of a scene's boards, with the noise of rendered pictures."""
    rng = np.random.default_rng(seed)
    shown = with_board(scene, board, count, seed)
    assert isinstance(shown.target, ShownBoard)
    pairs = []
    for i, time in enumerate(shown.times(count)):
        points = shown.target.points(float(time))
        pixels = shown.measurements(np.full(len(points), time), points)
        seen = [p + rng.normal(scale=CORNER_NOISE, size=p.shape) for p in pixels]
        pairs.append(BoardPair(f'{i}', *(BoardView(np.arange(54), p, 2.0) for p in seen)))
    return pairs


def test_enough_pictures_give_positions_within_one_and_a_half_of_the_true_calibration() -> None:
    """With the index and the distance known beforehand, as docs/calibration.md."""
    scene = washbowl(Choices(seed=5, rate=2.0))
    large, small = (Board('chessboard', 9, 6, square) for square in (0.05, 0.03))
    dry = boards_of(in_air(scene, 5), large, 100, 5)
    air = calibrate_stereo(dry, large, SIZES, most_views=100)
    wet = [pair.view(small) for pair in boards_of(scene, small, 40, 55)]
    known = {'target_index': 0.0005, 'distance': 0.001}
    guess = InterfaceGuess('interface', (1.0, 1.333), distance=0.8005, deviations=known)
    covariance = ParameterCovariance(air.state.names, air.adjustment.covariance)
    own = calibrate_interface(air.state, wet, [guess], covariance)

    times = scene.times(30)
    truth = scene.path.poses(times)[0]
    rng = np.random.default_rng(5)
    seen = [p + rng.normal(scale=CENTRE_NOISE, size=p.shape) for p in scene.measurements(times)]

    def position_rms(rig: StereoRig) -> float:
        errors = triangulate(rig, *seen).points - truth
        return float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))

    assert position_rms(own.state.rig()) < 1.5 * position_rms(scene.rig)
