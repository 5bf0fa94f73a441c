"""Stated deviations where the points of a view err alike: simulated, and on real pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from binopos_ros.calibration.adjustment.adjust import adjust
from binopos_ros.calibration.cameras.stereo import calibrate_stereo
from binopos_ros.calibration.interface.calibrate import calibrate_interface
from binopos_ros.calibration.views.board import Board
from binopos_ros.calibration.views.pairs import BoardPair
from binopos_ros.calibration.views.view import View
from binopos_ros.optics.rig_state import RigState

RIGS = 15


def bent(view: View, rng: np.random.Generator, amplitude: float) -> View:
    """A view whose points are shifted by a smooth field of its own (`amplitude` px RMS)."""
    board = view.points[:, :2]
    x, y = ((board - board.mean(axis=0)) / np.ptp(board, axis=0)).T
    waves = np.stack([x * x, x * y, y * y, x**3, x * x * y, x * y * y, y**3], axis=1)
    waves = (waves - waves.mean(axis=0)) / waves.std(axis=0)
    shift = amplitude / np.sqrt(waves.shape[1])
    return replace(
        view,
        pixels=tuple(
            pixels + shift * waves @ rng.normal(size=(waves.shape[1], 2)) for pixels in view.pixels
        ),
    )


def test_points_that_err_alike_widen_the_covariance(
    rig_maker: Any, board_viewer: Any, guesser: Any
) -> None:
    squares, factors = [], []
    for seed in range(RIGS):
        rng = np.random.default_rng(7000 + seed)
        rig, depths = rig_maker(('surface', 'wall', 'ports')[seed % 3], rng)
        seen = board_viewer(rig, depths, rng, noise=0.05, tilts=(15.0, 55.0))
        truth = RigState.of(rig)
        views = [bent(view, rng, 0.1) for view in seen]
        result = calibrate_interface(replace(truth, interfaces={}), views, guesser(rig))
        assert result.adjustment is not None
        own = [
            i
            for i, name in enumerate(truth.names)
            if name in result.prior and 'thick' not in name and 'indices' not in name
        ]
        error = truth.minus(result.state)[own]
        block = result.covariance[np.ix_(own, own)]
        squares.append(error @ np.linalg.solve(block, error) / len(own))
        factors.append(result.adjustment.variance_factor)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.5)
    assert np.mean(np.array(squares) * factors) > 3.0  # had they been taken for independent


def test_real_deviations_are_those_of_leaving_views_out(sample_pairs: list[BoardPair]) -> None:
    board = Board('chessboard', 9, 6, 0.025)
    result = calibrate_stereo(sample_pairs, board, ((640, 480), (640, 480)))
    fit, views = result.adjustment, result.views
    count = len(views)
    moved = []
    for out in range(count):
        rest = [i for i in range(count) if i != out]
        fewer = adjust(fit.state, [fit.poses[i] for i in rest], [views[i] for i in rest], fit.free)
        moved.append(fewer.state.minus(fit.state))
    # Tukey's jackknife takes nothing for granted but that the views are independent.
    scatter = (count - 1) / count * np.sum((moved - np.mean(moved, axis=0)) ** 2, axis=0)
    ratio = np.sqrt(scatter / np.diag(fit.covariance))
    assert fit.variance_factor > 3.0
    assert np.median(ratio) == pytest.approx(1.0, abs=0.35)
