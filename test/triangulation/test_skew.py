"""Free-running cameras: positions at the left stamp, the right image being of another time."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros.triangulation.stage import Centroid
from skewed_target import PATHS, PERIOD, circle, misses, positions, seen, triangulator


@pytest.mark.parametrize('skew', [-0.45, -0.2, 0.05, 0.2, 0.45])
@pytest.mark.parametrize('name', PATHS)
def test_positions_are_those_of_the_left_stamp_and_err_as_they_say(name: str, skew: float) -> None:
    path = PATHS[name]
    found = positions(triangulator(), seen(path, skew))
    assert len(found) >= 199
    errors, mean_square = misses(found, path)
    # Three degrees of freedom over 200 pairs; neighbours share a centroid.
    assert 2.3 < mean_square < 3.7
    deviations = np.sqrt([np.diag(p.covariance) for p in found[3:]])
    assert (np.abs(errors.mean(axis=0)) < 0.3 * deviations.mean(axis=0)).all()


@pytest.mark.parametrize('skew', [-0.2, 0.2])
def test_it_removes_what_the_skew_does(skew: float) -> None:
    """On the slow circle: seven millimetres of it, down to the noise's half a millimetre."""
    arrivals = seen(circle, skew)
    taken_as_it_is, _ = misses(positions(triangulator(triggered=True), arrivals), circle)
    brought_along, _ = misses(positions(triangulator(), arrivals), circle)
    together, _ = misses(positions(triangulator(), seen(circle, 0.0)), circle)
    rms = [np.sqrt((e**2).sum(axis=1).mean()) for e in (taken_as_it_is, brought_along, together)]
    assert rms[0] > 5e-3
    assert rms[1] < 1.35 * rms[2]


def test_equal_stamps_are_left_as_they_are() -> None:
    arrivals = seen(circle, 0.0, 30)
    for with_it, without in zip(
        positions(triangulator(), arrivals),
        positions(triangulator(triggered=True), arrivals),
        strict=True,
    ):
        np.testing.assert_array_equal(with_it.point, without.point)
        np.testing.assert_array_equal(with_it.covariance, without.covariance)


@pytest.mark.parametrize('late', ['left', 'right'])
def test_the_order_of_arrival_of_the_two_sides_changes_nothing(late: str) -> None:
    """A live node gets the sides as they come, `process` by their stamps."""
    arrivals = seen(circle, 0.3, 40)
    delayed = sorted(arrivals, key=lambda a: a[1].stamp + 10**8 * (a[0] == late))
    assert delayed != arrivals
    pair = zip(
        positions(triangulator(), arrivals), positions(triangulator(), delayed), strict=True
    )
    for one, other in pair:
        np.testing.assert_array_equal(one.point, other.point)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_a_target_not_followed_yet_is_uncertain_by_its_unknown_speed() -> None:
    found = positions(triangulator(), seen(circle, 0.2, 3))
    first, _, third = (np.sqrt(p.covariance[2, 2]) for p in found)
    assert first > 5 * third
    miss = found[0].point - circle(0.0)
    assert miss @ np.linalg.solve(found[0].covariance, miss) < 11.3


def test_a_wild_centroid_of_the_right_camera_shows_in_the_covariance_and_passes() -> None:
    arrivals = seen(circle, 0.3, 60)
    where = [i for i, (side, _) in enumerate(arrivals) if side == 'right'][30]
    wild = arrivals[where][1]
    arrivals[where] = (
        'right',
        Centroid(wild.stamp, 'right', wild.centre + 80.0, wild.covariance, 40.0),
    )
    found = positions(triangulator(), arrivals)
    stamps = [p.stamp for p in found]
    at = stamps.index(next(s for s in stamps if abs(s - wild.stamp) < PERIOD / 2 * 1e9))
    for after in range(1, 5):
        position = found[at + after]
        miss = position.point - circle((position.stamp - 10**18) * 1e-9)
        assert miss @ np.linalg.solve(position.covariance, miss) < 16.3
    assert found[at + 4].covariance[2, 2] < 4 * found[at - 1].covariance[2, 2]


def test_a_centroid_that_is_no_number_costs_its_own_pair_alone() -> None:
    arrivals = seen(circle, 0.3, 30)
    side, lost = arrivals[31]
    arrivals[31] = (side, Centroid(lost.stamp, side, np.full(2, np.nan), lost.covariance, 40.0))
    found = positions(triangulator(), arrivals)
    assert len(found) == 29
    errors, _ = misses(found, circle)
    assert np.linalg.norm(errors, axis=1).max() < 0.01
