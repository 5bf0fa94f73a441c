"""One camera: the published figures, OpenCV's own optimum, the outlier view."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.cameras.camera import calibrate_camera, check_determined
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import find_board
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.calibration.views.view import View
from binopos_ros.optics import PinholeCamera
from binopos_ros.optics.rig_state import exponential

PUBLISHED_FOCAL, PUBLISHED_RMS, PUBLISHED_WORST = 535.91573396, 0.39259099, 1.182
WINDOW, TOLERANCE = 11, 0.1  # the published ones (px)


@pytest.fixture(scope='module')
def published_views(samples: Path, sample_board: Board) -> list[View]:
    """The left pictures, refined with the published settings."""
    views = []
    for path in sorted(samples.glob('left??.jpg')):
        found = find_board(cv2.imread(str(path), 0), sample_board, WINDOW, TOLERANCE)
        views.append(BoardPair(path.stem, found, None).view(sample_board))
    return views


def test_published_calibration_is_reproduced(published_views: list[View]) -> None:
    fit = calibrate_camera(published_views, 0, (640, 480), square_pixels=True, robust=False)
    camera = fit.adjustment.state.cameras[0]
    assert camera.focal[0] == pytest.approx(PUBLISHED_FOCAL, rel=1e-3)
    assert camera.focal[0] == pytest.approx(camera.focal[1], rel=1e-6)
    assert fit.adjustment.rms() == pytest.approx(PUBLISHED_RMS, rel=2e-3)
    assert fit.adjustment.rms(view=1) == pytest.approx(PUBLISHED_WORST, rel=5e-3)


def test_outlier_view_02_is_found_with_its_reason(published_views: list[View]) -> None:
    fit = calibrate_camera(published_views, 0, (640, 480))
    assert list(fit.outlying) == ['left02']
    assert 'px' in fit.outlying['left02']


def test_without_the_outlier_the_focal_length_is_that_of_the_smaller_window(
    published_views: list[View],
) -> None:
    # 532.83 px with a 5x5 window, where the outlier vanishes; 535.9 with it and plain squares.
    fit = calibrate_camera(published_views, 0, (640, 480), square_pixels=True)
    assert fit.adjustment.state.cameras[0].focal[0] == pytest.approx(532.83, rel=1.5e-3)


def test_same_optimum_as_opencv(sample_pairs: list[BoardPair], sample_board: Board) -> None:
    views = [pair.view(sample_board) for pair in sample_pairs]
    fit = calibrate_camera(views, 1, (640, 480), robust=False)
    rms, matrix, lens, _, _ = cv2.calibrateCamera(
        [sample_board.points.astype(np.float32)] * len(views),
        [view.pixels[1].astype(np.float32) for view in views],
        (640, 480),
        np.eye(3),
        np.zeros(5),
    )
    camera = fit.adjustment.state.cameras[0]
    assert fit.adjustment.rms() == pytest.approx(rms, rel=1e-4)
    np.testing.assert_allclose(camera.matrix, matrix, atol=0.02)
    np.testing.assert_allclose(camera.lens, lens.ravel(), atol=2e-3)


def views_of(camera: PinholeCamera, tilts: list[tuple[float, float]], noise: float) -> list[View]:
    """A board seen by one camera under given tilts (degrees about x and y)."""
    rng = np.random.default_rng(5)
    points = Board('chessboard', 9, 6, 0.02).points
    views = []
    for i, (about_x, about_y) in enumerate(tilts):
        turned = exponential(np.radians([about_x, about_y, 0.0]))
        place = [-0.08 + 0.02 * (i % 3 - 1), -0.05 + 0.02 * (i % 2), 0.5 + 0.03 * i]
        pixels = camera.project(points @ turned.T + place)
        views.append(View(f'{i}', points, (pixels + rng.normal(scale=noise, size=pixels.shape),)))
    return views


TRUTH = PinholeCamera(
    [[900.0, 0.0, 650.0], [0.0, 905.0, 470.0], [0.0, 0.0, 1.0]],
    [-0.2, 0.08, 0.001, -0.001, 0.0],
    (1280, 960),
)
TILTS = [(30, 0), (-30, 5), (0, 35), (5, -35), (20, 20), (-20, 25), (25, -20), (0, 5), (40, 10)]


def test_simulated_camera_lies_within_its_stated_deviations() -> None:
    fit = calibrate_camera(views_of(TRUTH, TILTS, 0.1), 0, (1280, 960)).adjustment
    names = fit.state.names
    found = np.concatenate([fit.state.cameras[0].focal, fit.state.cameras[0].centre])
    truth = np.asarray(TRUTH.matrix)[[0, 1, 0, 1], [0, 1, 2, 2]]
    own = [names.index(f'left.{name}') for name in ('fx', 'fy', 'cx', 'cy')]
    covariance = fit.covariance[np.ix_(own, own)]
    error = found - truth
    assert error @ np.linalg.solve(covariance, error) < 18.5  # chi^2 with 4, 99.9 %
    assert fit.sigma == pytest.approx(0.1, rel=0.1)


def test_board_that_never_tilts_is_refused() -> None:
    flat = [(0.5 * (-1) ** i, 0.3 * i % 1) for i in range(8)]
    with pytest.raises(CalibrationError, match=r'never tilts enough.*30-45 degrees'):
        check_determined(calibrate_camera(views_of(TRUTH, flat, 0.1), 0, (1280, 960)), 0)


def test_too_few_views_are_refused() -> None:
    with pytest.raises(CalibrationError, match='at least 4'):
        calibrate_camera(views_of(TRUTH, TILTS[:3], 0.1), 0, (1280, 960))


def test_square_pixels_are_square() -> None:
    fit = calibrate_camera(views_of(TRUTH, TILTS, 0.1), 0, (1280, 960), square_pixels=True)
    focal = fit.adjustment.state.cameras[0].focal
    assert focal[0] == pytest.approx(focal[1], abs=1e-3)
