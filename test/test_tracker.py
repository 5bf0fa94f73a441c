"""The stages behind detection as one call, behind ports and under water, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros import Tracker
from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.parameters import ParameterError
from binopos_ros.smoothing.errors import SmoothingError
from binopos_ros.triangulation import triangulate
from binopos_ros.triangulation.errors import TriangulationError

CAMERA = PinholeCamera([[900, 0, 640], [0, 900, 480], [0, 0, 1]], [0, 0, 0, 0], (1280, 960))
NOISE = 0.05**2 * np.eye(2)


def behind_ports():
    port = FlatInterface([0.0, 0.0, 1.0], 0.03, [1.0, 1.5, 1.335], [0.006])
    return StereoRig(CAMERA, CAMERA, np.eye(3), [-0.2, 0, 0], None, port, port)


def through_air():
    return StereoRig(CAMERA, CAMERA, np.eye(3), [-0.2, 0, 0])


def swinging(rig, count=150, seed=1):
    """Return stamps, truth and noisy pixels of a target that swings by 0.1 m at 1 Hz."""
    random = np.random.default_rng(seed)
    stamps = np.arange(count) / 30.0
    swing = 0.1 * np.sin(2.0 * np.pi * stamps)
    truth = np.array([0.05, 0.0, 1.0]) + np.outer(swing, [1.0, 0.2, 0.3])
    left, right = rig.project(truth)
    noise = random.normal(0.0, 0.05, (2, count, 2))
    return stamps, truth, left + noise[0], right + noise[1]


@pytest.mark.parametrize('rig', [behind_ports(), through_air()], ids=['ports', 'air'])
def test_a_swinging_target_is_never_worse_than_its_raw_positions(rig):
    stamps, truth, left, right = swinging(rig)
    tracker = Tracker(rig)
    tracked = [tracker.step(*each, NOISE, NOISE) for each in zip(stamps, left, right, strict=True)]
    raw = np.array([each.position for each in tracked]) - truth
    error = np.array([each.pose.position for each in tracked]) - truth
    assert np.sqrt(np.mean(error[30:] ** 2)) < 1.05 * np.sqrt(np.mean(raw[30:] ** 2))
    spread = np.array([each.pose.covariance[:3, :3] for each in tracked])
    squares = np.einsum('ni,nij,nj->n', error, np.linalg.inv(spread), error)[30:] / 3.0
    assert 0.5 < squares.mean() < 2.0


def test_the_position_is_that_of_triangulate():
    rig = behind_ports()
    _, _, left, right = swinging(rig, 1)
    tracked = Tracker(rig).step(0.0, left[0], right[0], NOISE, NOISE)
    found = triangulate(rig, left[0], right[0], NOISE, NOISE)
    np.testing.assert_allclose(tracked.position, found.points, atol=1e-12)
    np.testing.assert_allclose(tracked.covariance, found.covariances, rtol=1e-9)
    assert tracked.reason == ''


def test_shared_errors_change_no_pose_and_are_added_to_its_covariance():
    rig = behind_ports()
    stamps, _, left, right = swinging(rig, 60)
    names = rig.parameter_names
    parameters = np.diag([1e-6 if 'normal' in name else 1e-8 for name in names])
    exact, unsure = Tracker(rig), Tracker(rig, parameter_covariance=parameters)
    for each in zip(stamps, left, right, strict=True):
        one, other = exact.step(*each, NOISE, NOISE), unsure.step(*each, NOISE, NOISE)
        np.testing.assert_allclose(other.pose.position, one.pose.position, atol=1e-12)
        shared = other.covariance - one.covariance
        added = other.pose.covariance - one.pose.covariance
        np.testing.assert_allclose(added[:3, :3], shared, rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(added[3:, 3:], 0.0, atol=1e-12)
        assert np.linalg.eigvalsh(shared).max() > 0.0


@pytest.mark.parametrize('jump', [-20.0, -3600.0, 3600.0])
def test_a_clock_that_jumps_silences_the_pose_for_less_than_a_second(jump):
    rig = behind_ports()
    stamps, truth, left, right = swinging(rig)
    stamps = np.where(np.arange(stamps.size) < 60, stamps, stamps + jump)
    tracker = Tracker(rig)
    tracked = [tracker.step(*each, NOISE, NOISE) for each in zip(stamps, left, right, strict=True)]
    silent = [number for number, each in enumerate(tracked) if each.pose is None]
    assert all(60 <= number < 90 for number in silent)
    assert all(tracked[number].reason for number in silent)
    assert np.linalg.norm(tracked[-1].pose.position - truth[-1]) < 0.003


def test_one_stamp_an_hour_ahead_silences_the_pose_for_less_than_a_second():
    rig = behind_ports()
    stamps, _, left, right = swinging(rig)
    stamps[60] += 3600.0
    tracker = Tracker(rig)
    tracked = [tracker.step(*each, NOISE, NOISE) for each in zip(stamps, left, right, strict=True)]
    silent = [number for number, each in enumerate(tracked) if each.pose is None]
    assert all(60 < number < 91 for number in silent)
    assert all(tracked[number].reason for number in silent)


def test_a_pair_that_saw_two_things_gives_its_reason_and_no_nan_to_the_filter():
    tracker = Tracker(behind_ports())
    tracked = tracker.step(0.0, [640, 480], [500, 600], NOISE, NOISE)
    assert tracked.pose is None
    assert 'same point' in tracked.reason
    assert np.isnan(tracked.position).all()


def test_wrong_options_and_shapes_are_named():
    with pytest.raises((ParameterError, SmoothingError), match='gate'):
        Tracker(behind_ports(), epipolar_gat=1.0)
    with pytest.raises(TriangulationError, match=r'left_px must have the shape \(2,\)'):
        Tracker(behind_ports()).step(0.0, [1, 2, 3], [1, 2])
    with pytest.raises(TriangulationError, match='parameter_covariance must be'):
        Tracker(behind_ports(), parameter_covariance=np.eye(2))
