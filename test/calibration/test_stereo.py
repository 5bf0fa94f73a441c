"""Stereo calibration: the real pairs, a simulated rig, the lens test, what is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.adjustment.adequacy import adequacy, better_by
from binopos_ros.calibration.adjustment.adjust import adjust
from binopos_ros.calibration.cameras.camera import calibrate_camera
from binopos_ros.calibration.cameras.given import GivenCameras
from binopos_ros.calibration.cameras.lens import blind_share
from binopos_ros.calibration.cameras.stereo import (
    StereoCalibration,
    calibrate_stereo,
    seen_by_both,
)
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.report.quality import concerns
from binopos_ros.calibration.report.summary import summarise_stereo
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.optics import PinholeCamera, StereoRig
from binopos_ros.optics.covariance_file import ParameterCovariance
from binopos_ros.optics.rig_state import RigState, exponential, logarithm

SIZES = ((640, 480), (640, 480))
LARGE = ((1280, 960), (1280, 960))
BOARD = Board('chessboard', 9, 6, 0.025)
BARREL = [-0.2, 0.08, 0.001, -0.001, 0.0]
#: No five terms follow this lens to a tenth of a pixel.
RATIONAL = [1.2, 0.35, 0.0005, -0.0004, 0.02, 1.55, 0.72, 0.11]


@pytest.fixture(scope='module')
def real(sample_pairs: list[BoardPair]) -> StereoCalibration:
    return calibrate_stereo(sample_pairs, BOARD, SIZES)


def simulated(
    lens: list[float], count: int = 16, noise: float = 0.05, seed: int = 2
) -> tuple[StereoRig, list[BoardPair]]:
    """A rig in air, and the boards it has seen."""
    rng = np.random.default_rng(seed)
    matrix = [[700.0, 0.0, 640.0], [0.0, 702.0, 480.0], [0.0, 0.0, 1.0]]
    camera = PinholeCamera(matrix, lens, (1280, 960))
    rotation = exponential(np.array([0.01, 0.08, -0.005]))
    rig = StereoRig(camera, camera, rotation, -rotation @ [0.12, 0.001, 0.002])
    points = BOARD.points - BOARD.points.mean(axis=0)
    pairs: list[BoardPair] = []
    while len(pairs) < count:
        turned = exponential(rng.uniform([-0.7, -0.7, -0.3], [0.7, 0.7, 0.3]))
        depth = rng.uniform(0.3, 0.55)
        place = np.array([0.06, 0.0, depth]) + depth * rng.uniform(
            [-0.45, -0.45, 0.0], [0.45, 0.45, 0.0]
        )
        seen = rig.project(points @ turned.T + place)
        if all(np.isfinite(p).all() and (p > 0).all() and (p < [1279, 959]).all() for p in seen):
            views = [
                BoardView(np.arange(54), p + rng.normal(scale=noise, size=p.shape), 2.0)
                for p in seen
            ]
            pairs.append(BoardPair(f'{len(pairs):02d}', *views))
    return rig, pairs


def test_real_pairs_reach_the_published_error(real: StereoCalibration) -> None:
    fit = real.adjustment
    assert fit.rms() <= 0.22
    assert not real.dropped
    assert real.state.cameras[0].focal[0] == pytest.approx(532.83, rel=5e-3)
    assert real.state.cameras[1].focal[0] == pytest.approx(537.45, rel=5e-3)
    assert np.linalg.norm(real.state.translation) / BOARD.square == pytest.approx(3.3273, abs=0.01)
    turn = np.degrees(logarithm(real.state.rotation))
    np.testing.assert_allclose(turn, [0.392, 0.223, -0.215], atol=0.05)


def test_held_out_error_of_the_real_pairs(real: StereoCalibration) -> None:
    assert real.adjustment.rms() < real.held_out.rms < 0.22
    assert real.held_out.transfer < 0.30
    assert [len(camera.lens) for camera in real.state.cameras] == [5, 5]


def test_same_optimum_as_opencv(sample_pairs: list[BoardPair], real: StereoCalibration) -> None:
    points = [BOARD.points.astype(np.float32)] * len(sample_pairs)
    sides = [
        [np.asarray(getattr(p, side).pixels, np.float32) for p in sample_pairs]
        for side in ('left', 'right')
    ]
    mono = [cv2.calibrateCamera(points, s, (640, 480), np.eye(3), np.zeros(5)) for s in sides]
    rms, *_, translation, _, _ = cv2.stereoCalibrate(
        points,
        *sides,
        mono[0][1],
        mono[0][2],
        mono[1][1],
        mono[1][2],
        (640, 480),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-9),
    )
    # OpenCV's board is flat.
    views = [pair.view(BOARD) for pair in sample_pairs]
    free = np.ones(len(real.state.names), bool)
    flat = adjust(real.state, real.adjustment.poses, views, free, robust=False)
    assert flat.rms() == pytest.approx(rms, rel=0.01)
    np.testing.assert_allclose(flat.state.translation, translation.ravel(), atol=2e-4)


def test_simulated_rig_lies_in_the_stated_region() -> None:
    rig, pairs = simulated(BARREL)
    result = calibrate_stereo(pairs, BOARD, LARGE)
    error = result.state.minus(RigState.of(rig))
    square = error @ np.linalg.solve(result.adjustment.covariance, error)
    assert square < 51.2  # chi^2 with 24, 99.9 %
    assert result.adjustment.sigma == pytest.approx(0.05, rel=0.08)
    assert len(result.state.cameras[0].lens) == 5


def test_rational_lens_is_taken_where_five_terms_do_not_do() -> None:
    rig, pairs = simulated(RATIONAL, count=24, noise=0.03)
    result = calibrate_stereo(pairs, BOARD, LARGE)
    assert any('rational lens (RMS' in lens.text for lens in result.lenses)
    terms = [5 if lens.five is None or lens.five.adequate else 8 for lens in result.lenses]
    assert [len(camera.lens) for camera in result.state.cameras] == terms
    assert result.held_out.rms < 0.05
    rays = rig.left.unproject(np.array([[400.0, 300.0], [640.0, 480.0], [900.0, 650.0]]))
    np.testing.assert_allclose(
        result.state.cameras[0].pinhole().project(rays), rig.left.project(rays), atol=0.5
    )


def test_adequacy_finds_a_systematic_ring() -> None:
    _, pairs = simulated(BARREL)
    result = calibrate_stereo(pairs, BOARD, LARGE)
    fit, views = result.adjustment, result.views
    assert adequacy(fit, views, 0).adequate
    bent = []
    for view, residuals in zip(views, fit.residuals, strict=True):
        away = view.pixels[0] - fit.state.cameras[0].centre
        radius = np.linalg.norm(away, axis=1, keepdims=True)
        wave = 0.06 * np.cos(radius / 80.0) * away / radius
        bent.append((residuals[0] + wave, residuals[1]))
    assert not adequacy(replace(fit, residuals=tuple(bent)), views, 0).adequate


WIDE_BOARD = Board('chessboard', 11, 8, 0.1)
WIDE_SIZE = (1280, 640)
#: An equidistant lens to a hundred-thousandth, 120 degrees wide here.
WIDE = [0.992, 0.2041, 0.0003, -0.0002, 0.0046, 1.3253, 0.4459, 0.0307]
WIDE_NOISE = 0.15  # px


def wide_angle(seed: int, count: int) -> list[BoardPair]:
    """What a wide-angle rig sees of boards that fill its pictures."""
    rng = np.random.default_rng(seed)
    matrix = [[420.0, 0.0, 642.0], [0.0, 420.0, 316.0], [0.0, 0.0, 1.0]]
    camera = PinholeCamera(matrix, WIDE, WIDE_SIZE)
    rotation = exponential(rng.uniform(-0.01, 0.01, 3))
    rig = StereoRig(camera, camera, rotation, -rotation @ [0.07, 0.0, 0.0])
    points = WIDE_BOARD.points - WIDE_BOARD.points.mean(axis=0)
    pairs: list[BoardPair] = []
    while len(pairs) < count:
        turned = exponential(rng.uniform([-0.6, -0.6, -0.3], [0.6, 0.6, 0.3]))
        ray = camera.unproject(rng.uniform([0, 0], WIDE_SIZE))
        seen = rig.project(points @ turned.T + rng.uniform(0.7, 2.0) * ray)
        if all(np.isfinite(p).all() and (p > 0).all() and (p < [1279, 639]).all() for p in seen):
            noisy = [p + rng.normal(scale=WIDE_NOISE, size=p.shape) for p in seen]
            views = [BoardView(np.arange(88), p, 2.0) for p in noisy]
            pairs.append(BoardPair(f'{len(pairs):02d}', *views))
    return pairs


@pytest.fixture(scope='module')
def wide() -> StereoCalibration:
    return calibrate_stereo(wide_angle(5, 12), WIDE_BOARD, (WIDE_SIZE, WIDE_SIZE))


def test_a_wide_lens_is_found_before_good_pairs_are_called_bad(wide: StereoCalibration) -> None:
    assert [len(camera.lens) for camera in wide.state.cameras] == [8, 8]
    assert wide.dropped == ()
    assert wide.held_out.rms < 1.1 * np.sqrt(2.0) * WIDE_NOISE
    assert not any(blind_share(camera) for camera in wide.state.cameras)
    assert 1000 * np.linalg.norm(wide.state.translation) == pytest.approx(70.0, abs=0.2)
    assert concerns(wide) == []


def test_a_lens_that_misses_is_called_poor(wide: StereoCalibration) -> None:
    """Five terms, as the left camera's own views would have them."""
    left = calibrate_camera(wide.views, 0, WIDE_SIZE, lens='brown').adjustment
    state = replace(wide.state, cameras=(left.state.cameras[0], wide.state.cameras[1]))
    poor = replace(
        wide,
        adjustment=replace(wide.adjustment, state=state),
        held_out=replace(wide.held_out, rms=left.rms()),
    )
    found = concerns(poor)
    assert len(found) == 2
    assert 'of the left picture has no ray in this lens model' in found[0]
    assert 'the result is poor' in found[1]


def test_one_view_that_dominates_does_not_decide() -> None:
    worse = np.array([0.5, 0.4, 0.6, 0.5, 0.7, 300.0, 0.5])
    assert better_by(worse, 0.5 * worse) > 2.0
    assert better_by(worse, np.where(worse > 1.0, 0.1, 1.1 * worse)) < 2.0


def test_pairs_given_four_times_count_once(sample_pairs: list[BoardPair]) -> None:
    once = calibrate_stereo(sample_pairs[:6], BOARD, SIZES)
    often = calibrate_stereo(sample_pairs[:6] * 4, BOARD, SIZES)
    assert len(often.views) == 6
    assert sum('repeats' in one.reason for one in often.dropped) == 18
    name = 'translation.x'
    assert often.adjustment.deviation(name) == pytest.approx(once.adjustment.deviation(name))


def test_a_bowed_board_is_found_and_taken_into_account() -> None:
    truth = np.array([0.001, 0.0003, -0.0002])
    rig, _ = simulated(BARREL, count=1)
    rng = np.random.default_rng(0)
    points = BOARD.points - BOARD.points.mean(axis=0)
    u, v = points[:, 0] / points[:, 0].max(), points[:, 1] / points[:, 1].max()
    points[:, 2] = np.stack([u * u, v * v, u * v], axis=1) @ truth
    pairs: list[BoardPair] = []
    while len(pairs) < 12:
        turned = exponential(rng.uniform([-0.7, -0.7, -0.3], [0.7, 0.7, 0.3]))
        aside = rng.uniform([-0.18, -0.18, 0.35], [0.3, 0.18, 0.55])
        seen = rig.project(points @ turned.T + aside)
        if all((p > 0).all() and (p < [1279, 959]).all() for p in seen):
            noisy = [p + rng.normal(scale=0.05, size=p.shape) for p in seen]
            views = [BoardView(np.arange(54), p, 2.0) for p in noisy]
            pairs.append(BoardPair(f'{len(pairs):02d}', *views))
    result = calibrate_stereo(pairs, BOARD, LARGE)
    np.testing.assert_allclose(result.shape.warp, truth, atol=4.0 * result.shape.deviations.max())
    assert result.shape.deviations.max() < 2e-5
    error = result.state.minus(RigState.of(rig))
    square = error @ np.linalg.solve(result.adjustment.covariance, error)
    assert square < 51.2  # chi^2 with 24, 99.9 %
    assert 'bowed by +1.00 mm along its rows' in summarise_stereo(result)


def test_what_one_camera_alone_sees_counts_for_its_lens() -> None:
    _, pairs = simulated(BARREL)
    alone = [pair if i < 8 else replace(pair, right=None) for i, pair in enumerate(pairs)]
    few, more = (calibrate_stereo(each, BOARD, LARGE) for each in (pairs[:8], alone))
    assert len(more.views) == 16
    assert seen_by_both(more.views) == 8
    assert more.adjustment.deviation('left.fx') < 0.85 * few.adjustment.deviation('left.fx')


def test_given_cameras_are_kept_and_only_the_pose_is_found() -> None:
    rig, pairs = simulated(BARREL, count=8)
    truth = RigState.of(rig)
    left, right = truth.cameras
    kept = calibrate_stereo(pairs, BOARD, LARGE, given=GivenCameras((left, right)))
    error = kept.state.minus(truth)
    assert not error[:-6].any()
    error = error[-6:]
    square = error @ np.linalg.solve(kept.adjustment.covariance[-6:, -6:], error)
    assert square < 22.5  # chi^2 with 6, 99.9 %

    known = ParameterCovariance(('left.fx', 'right.fx'), np.diag([4.0, 4.0]))
    refined = calibrate_stereo(pairs, BOARD, LARGE, given=GivenCameras((left, right), known))
    assert 0.0 < refined.adjustment.deviation('left.fx') < 0.5
    assert refined.adjustment.deviation('left.fy') == 0.0
    with pytest.raises(CalibrationError, match='use the same resolution'):
        calibrate_stereo(pairs, BOARD, SIZES, given=GivenCameras((left, right)))


def moved(view: BoardView, shift: tuple[float, float]) -> BoardView:
    return replace(view, pixels=view.pixels + shift)


def test_a_pair_whose_board_moved_is_left_out_with_the_reason() -> None:
    _, pairs = simulated(BARREL)
    assert pairs[3].right is not None
    pairs[3] = replace(pairs[3], right=moved(pairs[3].right, (4.0, 12.0)))
    result = calibrate_stereo(pairs, BOARD, LARGE)
    assert [one.name for one in result.dropped] == ['03']
    assert 'moved' in result.dropped[0].reason


def test_a_view_of_a_board_of_another_size_is_left_out() -> None:
    rig, pairs = simulated(BARREL)
    points = 1.2 * (BOARD.points - BOARD.points.mean(axis=0)) @ exponential(
        np.array([0.4, 0.2, 0.0])
    ).T + [0.06, 0.0, 0.5]
    seen = [BoardView(np.arange(54), p, 2.0) for p in rig.project(points)]
    pairs[5] = BoardPair('foreign', *seen)
    result = calibrate_stereo(pairs, BOARD, LARGE)
    assert [one.name for one in result.dropped] == ['foreign']
    assert 'seem 1.20 times as large' in result.dropped[0].reason


def test_blurred_pairs_are_left_out() -> None:
    _, pairs = simulated(BARREL)
    assert pairs[7].left is not None
    pairs[7] = replace(pairs[7], left=replace(pairs[7].left, sharpness=9.0))
    result = calibrate_stereo(pairs, BOARD, LARGE)
    assert [one.name for one in result.dropped] == ['07']
    assert 'blurred' in result.dropped[0].reason


def test_of_many_views_the_useful_ones_are_kept() -> None:
    _, pairs = simulated(BARREL, count=18)
    twins = [replace(pairs[0], name=f'twin {i}') for i in range(10)]
    result = calibrate_stereo([*twins, *pairs], BOARD, LARGE, most_views=18)
    kept = [view.name for view in result.views]
    assert len(kept) == 18
    assert sum(name.startswith('twin') for name in kept) <= 2


def refusal(pairs: list[BoardPair]) -> str:
    with pytest.raises(CalibrationError) as caught:
        calibrate_stereo(pairs, BOARD, SIZES)
    return str(caught.value)


def test_swapped_cameras_are_refused(sample_pairs: list[BoardPair]) -> None:
    line = refusal([BoardPair(p.name, p.right, p.left) for p in sample_pairs])
    assert 'left and right are swapped' in line
    assert '83 mm' in line


@pytest.mark.parametrize('side', ['left', 'right'])
def test_a_mirrored_camera_is_named(sample_pairs: list[BoardPair], side: str) -> None:
    mirrored = []
    for pair in sample_pairs:
        view = getattr(pair, side)
        grid = view.pixels.reshape(6, 9, 2)[::-1].copy()  # as the mirrored board is numbered
        grid[..., 0] = 639 - grid[..., 0]
        mirrored.append(replace(pair, **{side: replace(view, pixels=grid.reshape(-1, 2))}))
    assert f"switch off the {side} camera's mirror mode" in refusal(mirrored)


def test_shifted_lists_are_named(sample_pairs: list[BoardPair]) -> None:
    shifted = [replace(one, right=other.right) for one, other in pairwise(sample_pairs)]
    assert 'the two lists are shifted' in refusal(shifted)


def test_unsynchronised_pairs_are_refused(sample_pairs: list[BoardPair]) -> None:
    order = np.random.default_rng(1).permutation(len(sample_pairs))
    mixed = [
        replace(pair, right=sample_pairs[i].right)
        for pair, i in zip(sample_pairs, order, strict=True)
    ]
    assert 'not taken at the same time' in refusal(mixed)


def test_too_few_pairs_are_refused(sample_pairs: list[BoardPair]) -> None:
    assert 'in 3 of 3 pairs, at least 4' in refusal(sample_pairs[:3])
    blind = [replace(pair, right=None) for pair in sample_pairs]
    assert 'in 0 of 13 pairs' in refusal(blind)


def test_a_board_that_never_tilts_is_refused() -> None:
    rig, _ = simulated(BARREL, count=1)
    points = BOARD.points - BOARD.points.mean(axis=0)
    flat = []
    for i in range(8):
        place = [0.06 + 0.02 * (i - 4), 0.03 * (i % 3 - 1), 0.5]
        flat.append(
            BoardPair(
                f'{i}',
                *(BoardView(np.arange(54), p, 2.0) for p in rig.project(points + place)),
            )
        )
    with pytest.raises(CalibrationError, match=r'never tilts enough.*30-45 degrees'):
        calibrate_stereo(flat, BOARD, LARGE)
