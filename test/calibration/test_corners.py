"""Boards in pictures: real ones, rendered ones with known corners, both of OpenCV's ChArUcos."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board, parse_size
from binopos_ros.calibration.views.corners import find_board, refinement_window
from binopos_ros.calibration.views.other_board import largest_board
from binopos_ros.calibration.views.pairs import BoardPair

OVERSAMPLING = 4
HOMOGRAPHY = np.array([[9.0, 1.2, 180.0], [-0.7, 8.6, 140.0], [0.0012, 0.0007, 1.0]])
needs_charuco = pytest.mark.skipif(
    not hasattr(cv2, 'aruco'), reason='this OpenCV is older than 4.7 and has no contrib modules'
)


def rendered(texture: np.ndarray, per_unit: float, margin: float) -> np.ndarray:
    """A texture seen through HOMOGRAPHY (board units to px), antialiased, slightly blurred.

    The board's unit square number (0, 0) begins `margin` units into the texture.
    """
    to_board = np.array(
        [[1 / per_unit, 0, 0.5 / per_unit - margin], [0, 1 / per_unit, 0.5 / per_unit - margin]]
    )
    to_board = np.vstack([to_board, [0, 0, 1]])
    fine = np.diag([OVERSAMPLING, OVERSAMPLING, 1.0])
    fine[:2, 2] = (OVERSAMPLING - 1) / 2
    size = (640 * OVERSAMPLING, 480 * OVERSAMPLING)
    large = cv2.warpPerspective(
        texture, fine @ HOMOGRAPHY @ to_board, size, flags=cv2.INTER_LINEAR, borderValue=255
    )
    small = cv2.resize(large, (640, 480), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), 0.7)


def seen(points: np.ndarray) -> np.ndarray:
    """Board points (N, 2) in HOMOGRAPHY's units, in pixels."""
    return cv2.perspectiveTransform(points[None].astype(float), HOMOGRAPHY)[0]


def chessboard(columns: int, rows: int, unit: int, side: float) -> np.ndarray:
    squares = (np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2) * 255
    picture = np.kron(squares, np.ones((int(unit * side),) * 2)).astype(np.uint8)
    return cv2.copyMakeBorder(picture, *[int(2 * unit)] * 4, cv2.BORDER_CONSTANT, value=255)


def test_chessboard_corners_of_a_rendered_picture() -> None:
    unit, side = 20, 4.0
    picture = rendered(chessboard(9, 6, unit, side), unit, 2.0)
    view = find_board(picture, Board('chessboard', 9, 6, 0.02))
    assert view is not None
    expected = seen(Board('chessboard', 9, 6, 0.02).points[:, :2] / 0.02 * side + side)
    assert np.sqrt(np.mean((view.pixels - expected) ** 2)) < 0.03
    assert 1.0 < view.sharpness < 3.0


def test_soft_pictures_have_a_longer_rise() -> None:
    picture = rendered(chessboard(9, 6, 20, 4.0), 20, 2.0)
    board = Board('chessboard', 9, 6, 0.02)
    sharp, soft = (
        find_board(picture, board),
        find_board(cv2.GaussianBlur(picture, (0, 0), 2), board),
    )
    assert sharp is not None
    assert soft is not None
    assert soft.sharpness > 1.8 * sharp.sharpness


def test_turned_chessboards_are_numbered_from_the_same_corner() -> None:
    picture = rendered(chessboard(9, 6, 20, 4.0), 20, 2.0)
    board = Board('chessboard', 9, 6, 0.02)
    upright, turned = find_board(picture, board), find_board(cv2.rotate(picture, 1), board)
    assert upright is not None
    assert turned is not None
    np.testing.assert_allclose(np.array([639, 479]) - turned.pixels, upright.pixels, atol=0.05)


@pytest.mark.parametrize('kind', ['circles', 'asymmetric-circles'])
def test_circle_centres_of_a_rendered_picture(kind: str) -> None:
    board = Board(kind, 4, 7, 0.004) if kind != 'circles' else Board(kind, 7, 5, 0.005)
    unit, margin = 20, 6.0
    places = 1000.0 * board.points[:, :2]
    extent = places.max(axis=0) + 2 * margin
    texture = np.full((int(extent[1] * unit), int(extent[0] * unit)), 255, np.uint8)
    for x, y in (places + margin) * unit - 0.5:
        centre = (round(x * 16), round(y * 16))
        cv2.circle(texture, centre, int(1.2 * unit * 16), 0, -1, cv2.LINE_AA, 4)
    view = find_board(rendered(texture, unit, margin), board)
    assert view is not None
    # A circle's image is centred a little off its centre's image: here up to 0.1 px.
    expected = seen(places)
    error = np.minimum(
        np.abs(view.pixels - expected).max(axis=1),
        np.abs(view.pixels[::-1] - expected).max(axis=1),
    )
    assert error.max() < 0.2


@needs_charuco
def test_charuco_corners_of_a_rendered_picture() -> None:
    board = Board('charuco', 7, 5, 5.0 / 1000, 3.5 / 1000, 'DICT_4X4_50')
    texture = np.where(board.print(100)[0] > 0, 0, 255).astype(np.uint8)
    texture = cv2.copyMakeBorder(texture, *[40] * 4, cv2.BORDER_CONSTANT, value=255)
    view = find_board(rendered(texture, 20, 2.0), board)
    assert view is not None
    assert len(view.indices) == 24
    expected = seen(board.points[view.indices, :2] * 1000 + 5.0)
    assert np.sqrt(np.mean((view.pixels - expected) ** 2)) < 0.1


@needs_charuco
def test_charuco_of_the_tutorial_and_its_mirror_image(samples: Path) -> None:
    picture = cv2.imread(str(samples / 'aruco' / 'choriginal.jpg'))
    board = Board('charuco', 5, 7, 0.04, 0.02, 'DICT_6X6_250')
    view = find_board(picture, board)
    assert view is not None
    assert len(view.indices) == 24
    with pytest.raises(CalibrationError, match='mirror'):
        find_board(np.ascontiguousarray(picture[:, ::-1]), board)


@needs_charuco
def test_partly_covered_charuco_is_used(samples: Path) -> None:
    picture = cv2.imread(str(samples / 'aruco' / 'choriginal.jpg'))
    board = Board('charuco', 5, 7, 0.04, 0.02, 'DICT_6X6_250')
    whole = find_board(picture, board)
    picture[:260] = 128
    part = find_board(picture, board)
    assert whole is not None
    assert part is not None
    assert 6 <= len(part.indices) < 24
    _, own, others = part.common(whole)
    np.testing.assert_allclose(own, others, atol=0.5)


def test_window_stays_clear_of_the_neighbours(
    sample_pairs: list[BoardPair], sample_board: Board
) -> None:
    for pair in sample_pairs:
        for view in pair.sides:
            assert view is not None
            grid = view.pixels.reshape(6, 9, 2)
            spacing = min(np.linalg.norm(np.diff(grid, axis=a), axis=2).min() for a in (0, 1))
            assert refinement_window(view.pixels, sample_board) < 0.5 * spacing


def test_a_picture_without_a_board_gives_none() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (240, 320), dtype=np.uint8)
    for kind in ('chessboard', 'circles', 'asymmetric-circles'):
        assert find_board(noise, Board(kind, 9, 6, 0.02)) is None
    if hasattr(cv2, 'aruco'):
        assert find_board(noise, Board('charuco', 9, 6, 0.02, 0.01)) is None


@pytest.mark.parametrize('size', [(9, 7), (8, 6), (7, 5)])
def test_the_board_that_is_there_is_named(samples: Path, size: tuple[int, int]) -> None:
    pictures = [cv2.imread(str(samples / f'left{i:02d}.jpg'), 0) for i in (1, 2, 3)]
    other, holding = largest_board(pictures, Board('chessboard', *size, 0.025))
    assert other is not None
    assert (other.columns, other.rows) == (9, 6)
    assert holding == 3


@pytest.mark.parametrize(
    ('board', 'line'),
    [
        (('chessboard', 9, 6, 25.0), 'millimetres were given'),
        (('chessboard', 9, 6, -1.0), 'printed side in metres'),
        (('chessboard', 2, 6, 0.02), 'too small'),
        (('checker', 9, 6, 0.02), 'choose one of'),
        (('charuco', 9, 6, 0.02, 0.03), 'smaller than the square'),
        pytest.param(('charuco', 9, 6, 0.02, 0.01, 'DICT_X'), 'unknown', marks=needs_charuco),
    ],
)
def test_impossible_boards_are_refused(board: tuple, line: str) -> None:
    with pytest.raises(CalibrationError, match=line):
        Board(*board)


def test_charuco_without_opencvs_part_for_it_is_one_line(monkeypatch) -> None:
    monkeypatch.delattr(cv2, 'aruco', raising=False)
    with pytest.raises(CalibrationError, match='install opencv-contrib-python-headless'):
        Board('charuco', 9, 6, 0.02, 0.01)


@pytest.mark.parametrize('text', ['9', '9x', 'ax6', '9*6', ''])
def test_unreadable_sizes_are_refused(text: str) -> None:
    with pytest.raises(CalibrationError, match='9x6'):
        parse_size(text)


def test_sizes_are_read() -> None:
    assert parse_size('9x6') == parse_size(' 9 X 6 ') == (9, 6)
