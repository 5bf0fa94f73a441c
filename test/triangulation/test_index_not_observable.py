"""Where the rays tell nothing of the index: said every time, and shown by the covariance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from binopos_ros.triangulation.following import NOT_OBSERVABLE
from binopos_ros.triangulation.index import IndexEstimator
from index_settings import COVARIANCE, PIXEL_STD, flat, images, rig_through, run

SEEN_EQUALLY = {
    'over the middle of the baseline': (
        rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), (0.115, -0.3, 1.0), (0.115, 0.3, 1.3)
    ),
    'the same, the surface tilted across the baseline': (
        rig_through(flat((0, 0.5, 1), 0.6, 1, 1.355)), (0.115, -0.1, 1.0), (0.115, 0.3, 1.5)
    ),
    'behind glass': (
        rig_through(flat((0, 0, 1), 0.1, 1, 1.5, 1.355, glass=(0.01,))),
        (0.115, -0.3, 0.6), (0.115, 0.3, 1.0)
    ),
    'mirrored ports': (
        rig_through(
            None,
            flat((0.15, 0.1, 1), 0.05, 1, 1.355),
            flat((-0.15, 0.1, 1), 0.05, 1, 1.355),
        ),
        (0.115, -0.2, 0.6), (0.115, 0.2, 1.2)
    ),
    'in the plane of both centres and the normal': (
        rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), (-0.2, 0.0, 1.0), (0.5, 0.0, 1.4)
    ),
    'in that plane, the surface tilted along the baseline': (
        rig_through(flat((0.4, 0, 1), 0.5, 1, 1.355)), (-0.2, 0.0, 1.0), (0.4, 0.0, 1.6)
    ),
}  # fmt: skip


@pytest.mark.parametrize('name', SEEN_EQUALLY)
def test_where_the_index_cannot_be_seen_it_says_so_every_time(name):
    rig, low, high = SEEN_EQUALLY[name]
    random = np.random.default_rng(6)
    for _ in range(5):
        points = random.uniform(low, high, (60, 3))
        estimator = IndexEstimator(1.34, 0.015)
        noise = PIXEL_STD * random.standard_normal((60, 4))
        for state in run(estimator, rig, images(rig, points) + noise):
            assert state.reason == NOT_OBSERVABLE
            assert not state.observed
            assert (state.mean, state.std) == pytest.approx((1.34, 0.015), abs=1e-12)
            assert math.isnan(state.frame_index)


@pytest.mark.parametrize('name', SEEN_EQUALLY)
def test_there_the_positions_covariance_shows_what_the_index_leaves_open(name):
    rig, low, high = SEEN_EQUALLY[name]
    random = np.random.default_rng(7)
    squares = []
    for point in random.uniform(low, high, (200, 3)):
        truth = random.normal(1.355, 0.015)
        pixels = images(rig.with_target_index(truth), point) + PIXEL_STD * random.standard_normal(
            4
        )
        state = IndexEstimator(1.355, 0.015).update(
            rig, pixels[:2], pixels[2:], COVARIANCE, COVARIANCE
        )
        miss = state.point - point
        squares.append(miss @ np.linalg.solve(state.covariance, miss))
    assert np.mean(squares) == pytest.approx(3.0, abs=4 * math.sqrt(6 / 200))
