"""What the smoothing stage publishes: poses at a rate of their own, foretold for their time."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.smoothing.stage import make_smoother

DEVIATION = np.array([5e-5, 5e-5, 2e-4])
COVARIANCE = np.diag(DEVIATION**2)
VELOCITY = np.array([0.1, -0.03, 0.02])
START = 1_700_000_000_000_000_000


def place(stamp):
    """Return where the target is (3,), m, at a stamp (ns): on a line, at 0.1 m/s."""
    return np.array([0.1, -0.05, 1.2]) + 1e-9 * (stamp - START) * VELOCITY


def seen(smoother, seconds, random):
    """Give the smoother a position of that time after the start."""
    stamp = START + round(1e9 * seconds)
    measured = place(stamp) + random.normal(0.0, DEVIATION)
    return smoother.add(stamp, measured, COVARIANCE)


def test_nothing_is_foretold_of_a_target_whose_velocity_nobody_knows():
    smoother, random = make_smoother({}), np.random.default_rng(1)
    pose, reason = seen(smoother, 0.0, random)
    assert pose is not None
    assert reason == ''
    assert smoother.predict(START + 200_000_000) is None
    assert seen(smoother, 0.2, random)[0] is not None
    assert smoother.predict(START + 240_000_000) is not None
    # Nor once more after a gap in which it was given up.
    assert seen(smoother, 5.0, random)[0] is not None
    assert smoother.predict(START + 5_020_000_000) is None


@pytest.mark.parametrize('lost', [0.0, 0.5])
def test_poses_at_a_rate_of_their_own_are_near_the_target_from_the_first_on(lost):
    smoother, random = make_smoother({'output_rate': 60.0}), np.random.default_rng(2)
    errors, squares = [], []
    for frame in range(60):
        if frame < 2 or random.random() >= lost:
            seen(smoother, frame / 30.0, random)
        for tick in (0.6, 1.1):
            # A frame's picture has become a position by then.
            stamp = START + round(1e9 * (frame + tick) / 30.0)
            pose = smoother.predict(stamp)
            if pose is not None:
                error = pose.state.position - place(stamp)
                errors.append(np.linalg.norm(error))
                squares.append(error @ np.linalg.solve(pose.state.covariance[:3, :3], error))
    assert len(errors) >= 110
    assert max(errors) < 2e-3
    assert np.mean(squares) < 2.0 * 3.0
