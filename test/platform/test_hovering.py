"""A target before a hovering robot: what the platform says of each position is right."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.simulation.rig_motion import Odometer
from hovering import hovering, rms

POOR = Odometer(position_std=0.002, rotation_std=np.deg2rad(0.1))
GOOD = Odometer(position_std=0.0005, rotation_std=np.deg2rad(0.02))
SEEDS = range(6)


@pytest.mark.parametrize('odometer', [POOR, GOOD], ids=['poor', 'good'])
@pytest.mark.parametrize(('distance', 'pixels'), [(1.0, 0.05), (2.0, 0.05), (3.0, 0.3)])
def test_a_mean_by_the_stated_covariances_is_the_best_and_errs_as_it_says(
    distance, pixels, odometer
):
    runs = [hovering(distance, pixels, odometer, seed, count=150) for seed in SEEDS]
    own, optimal = (
        rms(np.concatenate([getattr(run, name) for run in runs])) for name in ('own', 'optimal')
    )
    assert own <= 1.1 * optimal
    square = np.mean([run.own_square.mean() for run in runs])
    assert 0.7 <= square <= 1.5


@pytest.mark.parametrize('moving', [False, True], ids=['at rest', 'moving'])
@pytest.mark.parametrize(('distance', 'pixels'), [(1.0, 0.05), (2.0, 0.3)])
def test_the_pose_is_never_worse_than_the_position_in_the_fixed_frame(distance, pixels, moving):
    for odometer in (POOR, GOOD):
        run = hovering(distance, pixels, odometer, seed=11, moving=moving, count=200)
        assert rms(run.pose) <= (1.0 if moving else 0.5) * rms(run.raw)
        assert 0.2 <= run.pose_square.mean() <= 1.5
