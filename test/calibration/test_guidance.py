"""Guidance: predicted gains come true, useless views are passed over, it knows when to stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.live.guidance import Guidance, Guide, Sizes, Solution
from binopos_ros.calibration.live.session import LiveSession
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.corners import BoardView
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.optics.rig_state import RigState

BOARD = Board('chessboard', 9, 6, 0.02)
SIZES = ((1280, 960), (1280, 960))


@pytest.fixture(scope='module')
def course(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> tuple[list[Guide], Guidance, list[BoardPair]]:
    """Boards in water shown one after another until positions are good to 1 mm."""
    rng = np.random.default_rng(11)
    rig, depths = rig_maker('surface', rng)
    air = replace(RigState.of(rig), interfaces={})

    def solve(pairs: Sequence[BoardPair], sizes: Sizes) -> Solution:
        found = calibrate_interface(air, [pair.view(BOARD) for pair in pairs], guesser(rig))
        fit = found.adjustment
        assert fit is not None
        return Solution(found.state, found.covariance, fit.free, fit.sigma, fit.poses)

    pairs = [
        BoardPair(view.name, *(BoardView(np.arange(54), p, 2.0) for p in view.pixels))
        for view in board_viewer(rig, depths, rng, count=40)
    ]
    guidance = Guidance(BOARD, SIZES, solve, 0.001, 1.1)
    guides = []
    for pair in pairs:
        guidance.add(pair)  # the board comes to rest
        guides.append(guidance.add(pair))
        if guides[-1].done:
            break
    return guides, guidance, pairs


def test_it_stops_when_positions_are_good_enough(course: Any) -> None:
    guides, guidance, _ = course
    assert guides[-1].done
    assert guides[-1].error < 0.001
    assert guides[-1].hint.startswith('good enough')
    assert 6 <= guides[-1].views < 40
    assert guidance.error() == guides[-1].error


def test_predicted_gains_come_true(course: Any) -> None:
    guides, _, _ = course
    known = [
        (before.error - after.error, after.gain)
        for before, after in pairwise(guides)
        if after.taken and np.isfinite(after.gain)
    ]
    actual, promised = np.array(known).T
    assert len(actual) >= 3
    assert np.sum(actual) == pytest.approx(np.sum(promised), rel=0.35)


def test_hints_name_a_place_and_a_tilt(course: Any) -> None:
    guides, _, _ = course
    hints = [g.hint for g in guides if np.isfinite(g.error) and not g.done]
    assert hints
    assert all('hold it' in hint and 'of the left picture' in hint for hint in hints)
    for guide in guides:
        if 'hold it' in guide.hint:
            assert [outline.shape for outline in guide.outlines] == [(4, 2), (4, 2)]
            for outline, size in zip(guide.outlines, SIZES, strict=True):
                assert ((outline >= 0) & (outline < size)).all()
    assert guides[-1].outlines == ()


def test_a_moving_board_is_not_taken(course: Any) -> None:
    _, guidance, pairs = course
    guidance.add(pairs[-1])
    guide = guidance.add(pairs[-2])
    assert not guide.taken
    assert guide.reason == 'hold the board still'


def test_a_view_seen_by_one_camera_is_not_taken(course: Any) -> None:
    _, guidance, pairs = course
    guide = guidance.add(replace(pairs[0], right=None))
    assert guide.reason == 'no board in the right picture'


def test_the_same_view_twice_is_not_taken(sample_pairs: list[BoardPair]) -> None:
    def solve(pairs: Sequence[BoardPair], sizes: Sizes) -> Solution:
        raise CalibrationError('too few')

    board = Board('chessboard', 9, 6, 0.025)
    guidance = Guidance(board, ((640, 480), (640, 480)), solve, 0.001, 0.5)
    assert guidance.add(sample_pairs[0]).taken
    guide = guidance.add(sample_pairs[0])
    assert not guide.taken
    assert 'already taken' in guide.reason
    assert np.isnan(guide.error)
    assert 'more to begin with' in guide.hint


def test_a_session_on_real_pictures(samples: Path) -> None:
    board = Board('chessboard', 9, 6, 0.025)

    def solve(pairs: Sequence[BoardPair], sizes: Sizes) -> Solution:
        fit = calibrate_stereo(pairs, board, sizes).adjustment
        return Solution(fit.state, fit.covariance, fit.free, fit.sigma, fit.poses)

    session = LiveSession(board, solve, 1e-5, 0.4)
    for path in sorted(samples.glob('left0[1-7].jpg')):
        right = path.with_name(path.name.replace('left', 'right'))
        images = [cv2.imread(str(one), 0) for one in (path, right)]
        for _ in range(2):
            overlay, text = session.show(path.stem, *images)
        assert overlay.shape == (480, 1280, 3)
        assert 'next: ' in text
    assert len(session.pairs) >= 6
    # The board that the hint asks for is drawn in yellow, in both pictures.
    blue, green, red = np.moveaxis(overlay.astype(int), -1, 0)
    yellow = (red > 200) & (green > 170) & (blue < 90)
    assert yellow[:, :640].sum() > 100
    assert yellow[:, 640:].sum() > 100
    assert 'positions to' in text
    assert not session.done
    with pytest.raises(CalibrationError, match='changed their size'):
        session.show('small', images[0][:240, :320], images[1])
