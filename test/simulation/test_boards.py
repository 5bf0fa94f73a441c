"""Rendered calibration boards: their points, found by OpenCV, against where they are seen."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.charuco import find_corners
from binopos_ros.optics import PinholeCamera, StereoRig
from binopos_ros.simulation import PRESETS, Choices, Renderer, Scene, SimulationError
from binopos_ros.simulation.boards import BLACK, WHITE, ShownBoard, printed
from binopos_ros.simulation.presets import in_air, with_board
from binopos_ros.simulation.sensor import Sensor

CHESSBOARD = Board('chessboard', 7, 5, 0.03)
needs_charuco = pytest.mark.skipif(
    not hasattr(cv2, 'aruco'), reason='this OpenCV is older than 4.7 and has no contrib modules'
)


def shown(board: Board, medium: str) -> Scene:
    """Two boards before the washbowl's cameras, dry or under its calm water; no noise."""
    scene = PRESETS['demo'].make(Choices(rate=2.0))
    if medium == 'air':
        scene = in_air(scene, 0)
    scene = dataclasses.replace(scene, sensor=Sensor(noise=0.0, blur=0.5))
    return with_board(scene, board, 2, 4)


def picture(scene: Scene, side: int, time: float) -> np.ndarray:
    image = Renderer(scene, side).picture(time, np.random.default_rng(0))
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def nearest(found: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """(N, 2) how far each point that was found lies from the expected one next to it."""
    apart = found[:, None, :] - expected[None, :, :]
    best = np.linalg.norm(apart, axis=2).argmin(axis=1)
    assert len(set(best)) == len(found)
    return apart[np.arange(len(found)), best]


@pytest.mark.parametrize('medium', ['air', 'water'])
def test_chessboard_corners_are_found_where_they_are_seen(medium: str) -> None:
    scene = shown(CHESSBOARD, medium)
    for side in range(2):
        grey = picture(scene, side, 0.5)
        found, corners = cv2.findChessboardCornersSB(grey, (7, 5), flags=cv2.CALIB_CB_ACCURACY)
        assert found
        expected = scene.views[side].apparent(scene.target.points(0.5), 0.0)
        error = nearest(np.asarray(corners).reshape(-1, 2), expected)
        # The finder's own error; that the picture is right shows the next test.
        assert np.sqrt(np.mean(error**2)) < 0.1


def test_every_pixel_of_a_chessboard_holds_the_mean_of_its_square() -> None:
    """Against 40 x 40 rays through each pixel of a pinhole, and the chessboard's own formula."""
    board = Board('chessboard', 4, 3, 0.03)
    matrix = np.array([[100.0, 0, 31.3], [0, 100, 24.7], [0, 0, 1]])
    camera = PinholeCamera(matrix, np.zeros(5), (64, 50))
    scene = in_air(PRESETS['demo'].make(Choices()), 0)
    rotation = cv2.Rodrigues(np.array([0.5, -0.4, 0.2]))[0]
    position = np.array([-0.05, -0.04, 0.4])
    sheet, corner = printed(board)
    target = ShownBoard(board, sheet, corner, position[None], rotation[None], 1.0)
    scene = dataclasses.replace(
        scene,
        rig=StereoRig(camera, camera, np.eye(3), [-0.1, 0, 0]),
        path=target,
        target=target,
        sensor=Sensor(noise=0.0, blur=0.0, exposure=1.0),
    )
    light = Renderer(scene, 0).light(0.0)[..., 1] / 255
    ticks = (np.arange(40) + 0.5) / 40 - 0.5
    v, u = np.mgrid[:50, :64]
    x = (u[..., None, None] + ticks - 31.3) / 100
    y = (v[..., None, None] + ticks[:, None] - 24.7) / 100
    x, y = np.broadcast_arrays(x, y)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    steps = (rotation[:, 2] @ position) / (rays @ rotation[:, 2])
    places = (steps[..., None] * rays - position) @ rotation[:, :2] / board.square
    column, row = np.floor(places[..., 0]).astype(int), np.floor(places[..., 1]).astype(int)
    pattern = (column >= -1) & (column < 4) & (row >= -1) & (row < 3)
    black = pattern & ((column + row) % 2 == 0)
    sheet_covers = (np.abs(places - [1.5, 1.0]) < [3.5, 3.0]).all(axis=(2, 3, 4))
    expected = np.where(black, BLACK, WHITE).mean(axis=(2, 3))
    error = (light - expected)[sheet_covers]
    assert sheet_covers.sum() > 500
    # The print's texels round edges over a 48th of a square, which pixels see as next to nothing.
    assert np.abs(error).max() < 0.05
    assert np.sqrt(np.mean(error**2)) < 0.008
    assert abs(error.mean()) < 0.001


@pytest.mark.parametrize('kind', ['circles', 'asymmetric-circles'])
def test_circles_are_found_where_they_are_seen(kind: str) -> None:
    scene = shown(Board(kind, 5, 4, 0.03), 'air')
    grey = picture(scene, 0, 0.0)
    flag = cv2.CALIB_CB_SYMMETRIC_GRID if kind == 'circles' else cv2.CALIB_CB_ASYMMETRIC_GRID
    found, centres = cv2.findCirclesGrid(grey, (5, 4), flags=flag)
    assert found
    expected = scene.views[0].apparent(scene.target.points(0.0), 0.0)
    error = nearest(np.asarray(centres).reshape(-1, 2), expected)
    assert np.sqrt(np.mean(error**2)) < 0.1


@needs_charuco
def test_charuco_corners_bear_their_own_numbers() -> None:
    board = Board('charuco', 5, 4, 0.04, 0.03)
    scene = shown(board, 'air')
    found = find_corners(picture(scene, 0, 0.0), board)
    assert found is not None
    numbers, corners = found
    expected = scene.views[0].apparent(scene.target.points(0.0), 0.0)
    # Not refined: the finders of some versions of OpenCV are half a pixel off in both directions.
    np.testing.assert_allclose(corners, expected[numbers], atol=1.0)
    assert len(numbers) >= 8


def test_every_board_is_whole_in_both_pictures_and_elsewhere_each_time() -> None:
    scene = with_board(in_air(PRESETS['demo'].make(Choices(rate=2.0)), 0), CHESSBOARD, 12, 1)
    places, normals = scene.path.poses(np.arange(12) / 2)
    assert len(np.unique(places.round(4), axis=0)) == 12
    assert np.degrees(np.arccos(-normals[:, 2])).max() > 25
    for number in range(12):
        for view in scene.views:
            pixels = view.apparent(scene.target.points(number / 2), 0.0)
            assert ((pixels > 0) & (pixels < np.array(view.lens.size) - 1)).all()


def test_a_board_too_large_for_the_bowl_is_refused() -> None:
    with pytest.raises(SimulationError, match='give a smaller board'):
        with_board(PRESETS['demo'].make(Choices()), Board('chessboard', 9, 6, 0.1), 1, 0)


def test_a_board_that_is_held_stays_for_as_long_as_was_said() -> None:
    scene = in_air(PRESETS['demo'].make(Choices(rate=5.0)), 0)
    held = with_board(scene, CHESSBOARD, 32, 4, hold=2.0)
    positions = held.target.poses(held.times(32))[0]
    moved = np.flatnonzero(np.abs(np.diff(positions, axis=0)).max(axis=1) > 0) + 1
    assert list(moved) == [10, 20, 30]
