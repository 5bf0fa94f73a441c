"""The triangulation stage: what it waits for, what it hands on, what it drops and why."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from binopos_ros.optics import (
    CameraInfo,
    DomePort,
    FlatInterface,
    OpticsError,
    PinholeCamera,
    StereoRig,
)
from binopos_ros.parameters import UnfinishedError, build
from binopos_ros.triangulation.errors import TriangulationError
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Drop, Position, Triangulator

BASELINE, FOCAL = 0.23, 900.0
WATER = {
    'interface.normal': [0.05, 0.02, 1.0],
    'interface.distance': 0.8,
    'interface.indices': [1.0, 1.333],
    'interface.normal_std': 0.0,
    'interface.distance_std': 0.0,
    'baseline_std': 0.0,
}
POINT = np.array([0.35, 0.1, 1.25])
K = (FOCAL, 0, 640.0, 0, FOCAL, 480.0, 0, 0, 1.0)


def info(side: str, **changes) -> CameraInfo:
    shift = 0.0 if side == 'left' else -BASELINE * FOCAL
    p = (FOCAL, 0, 640.0, shift, 0, FOCAL, 480.0, 0, 0, 0, 1.0, 0)
    values = {
        'name': side,
        'width': 1280,
        'height': 960,
        'distortion_model': 'plumb_bob',
        'd': (0.0,) * 5,
        'k': K,
        'p': p,
    }
    return CameraInfo(**{**values, **changes})


def rig(index: float = 1.333) -> StereoRig:
    camera = PinholeCamera(np.reshape(K, (3, 3)), np.zeros(5), (1280, 960))
    surface = FlatInterface(WATER['interface.normal'], 0.8, (1.0, index))
    return StereoRig(camera, camera, np.eye(3), [-BASELINE, 0, 0], surface)


def centroids(point: np.ndarray, stamp: int = 0, index: float = 1.333) -> dict[str, Centroid]:
    pixels = dict(zip(('left', 'right'), rig(index).project(point), strict=True))
    covariance = 0.05**2 * np.eye(2)
    return {
        side: Centroid(stamp, f'{side}_camera', pixel, covariance, 40.0)
        for side, pixel in pixels.items()
    }


def triangulator(**values) -> Triangulator:
    return Triangulator(build(TriangulatorOptions, WATER | values))


def feed(stage: Triangulator, pair: dict[str, Centroid]) -> list[Position | Drop]:
    return [result for side, each in pair.items() for result in stage.add(side, each)]


def calibrate(stage: Triangulator) -> Triangulator:
    for side in ('left', 'right'):
        stage.set_camera(side, info(side))
    return stage


def test_a_pair_gives_one_position_with_the_left_images_stamp_and_frame():
    (found,) = feed(calibrate(triangulator()), centroids(POINT, 77))
    assert isinstance(found, Position)
    assert (found.stamp, found.frame_id) == (77, 'left_camera')
    np.testing.assert_allclose(found.point, POINT, atol=1e-9)
    assert np.linalg.eigvalsh(found.covariance).min() > 0
    assert (found.index.mean, found.index.std, found.index.observed) == (1.333, 0.0, False)


DOME = {
    'shape': 'dome',
    'centre': [0.001, -0.002, 0.004],
    'radius': 0.05,
    'thicknesses': [0.007],
    'indices': [1.0, 1.49, 1.333],
}


def domed(**changes) -> dict:
    return {
        f'{side}_port.{name}': value
        for side in ('left', 'right')
        for name, value in {**DOME, **changes}.items()
        if value is not None
    }


def test_domes_of_a_parameter_file_are_looked_through():
    stage = Triangulator(build(TriangulatorOptions, domed()))
    calibrate(stage)
    camera = PinholeCamera(np.reshape(K, (3, 3)), np.zeros(5), (1280, 960))
    dome = DomePort(DOME['centre'], 0.05, 0.007, (1.0, 1.49, 1.333))
    domes = StereoRig(camera, camera, np.eye(3), [-BASELINE, 0, 0], None, dome, dome)
    pixels = zip(('left', 'right'), domes.project(POINT), strict=True)
    covariance = 0.05**2 * np.eye(2)
    (found,) = feed(
        stage, {side: Centroid(5, 'camera', pixel, covariance, 40.0) for side, pixel in pixels}
    )
    np.testing.assert_allclose(found.point, POINT, atol=1e-9)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'shape': 'flat'}, r'left_port\.centre belongs to a dome'),
        ({'shape': None}, r'left_port\.centre belongs to a dome'),
        ({'centre': None}, r'left_port\.centre is missing'),
        ({'centre': [0.0, 0.0]}, r'left_port\.centre is missing'),
        ({'radius': None}, r'left_port\.radius is missing'),
        ({'thicknesses': None}, 'three indices .* and one thickness'),
        ({'indices': [1.0, 1.333]}, 'three indices .* and one thickness'),
        ({'normal': [0.0, 0.0, 1.0]}, r'left_port\.normal belongs to a flat port'),
        ({'distance': 0.1}, r'left_port\.distance belongs to a flat port'),
    ],
)
def test_a_dome_that_is_half_given_waits_for_the_rest(changes, words):
    with pytest.raises(UnfinishedError, match=words) as caught:
        build(TriangulatorOptions, domed(**changes))
    assert '\n' not in str(caught.value)


def test_a_dome_that_cannot_be_is_refused():
    with pytest.raises(OpticsError, match='must stand inside its dome'):
        build(TriangulatorOptions, domed(radius=0.003))


def test_pairs_that_come_before_the_calibration_are_not_lost():
    stage = triangulator()
    early = [result for k in range(5) for result in feed(stage, centroids(POINT, k))]
    assert early == []
    late = feed(calibrate(stage), centroids(POINT, 5))
    assert [position.stamp for position in late] == [0, 1, 2, 3, 4, 5]


def test_without_a_calibration_the_drop_names_the_camera_that_lacks_it():
    stage = triangulator()
    stage.set_camera('left', info('left'))
    assert feed(stage, centroids(POINT)) == []
    assert [drop.reason for drop in stage.flush()] == ['no camera_info from right']


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'k': (0.0,) * 9}, 'uncalibrated'),
        ({'distortion_model': 'mercator'}, 'mercator'),
        ({'distortion_model': 'fisheye'}, '4 terms'),
        ({'d': (float('nan'),) * 5}, 'left'),
    ],
)
def test_a_calibration_that_cannot_be_used_is_refused(changes, words):
    stage = triangulator()
    stage.set_camera('right', info('right'))
    with pytest.raises(OpticsError, match=words):
        stage.set_camera('left', info('left', **changes))


def test_a_refused_calibration_leaves_the_one_in_use_and_is_refused_each_time():
    stage = calibrate(triangulator())
    for _ in range(2):
        with pytest.raises(OpticsError, match='uncalibrated'):
            stage.set_camera('left', info('left', k=(0.0,) * 9))
    (found,) = feed(stage, centroids(POINT))
    np.testing.assert_allclose(found.point, POINT, atol=1e-9)


def test_refused_options_leave_those_in_use():
    stage = calibrate(triangulator())
    missing = WATER | {'calibration_covariance': '/nowhere/covariance.yaml'}
    with pytest.raises(ValueError, match='nowhere'):
        stage.configure(build(TriangulatorOptions, missing | {'interface.distance': 0.7}))
    (found,) = feed(stage, centroids(POINT))
    np.testing.assert_allclose(found.point, POINT, atol=1e-9)


def test_a_pair_that_sees_two_different_points_is_dropped():
    stage = calibrate(triangulator())
    other = centroids(POINT + np.array([0.0, 0.06, 0.0]))
    (drop,) = feed(stage, {'left': centroids(POINT)['left'], 'right': other['right']})
    assert drop.reason == 'left and right do not see the same point'


def test_nan_leaves_as_a_drop():
    stage = calibrate(triangulator())
    pair = centroids(POINT)
    pair['left'] = Centroid(0, 'left_camera', np.full(2, np.nan), np.eye(2), 40.0)
    (drop,) = feed(stage, pair)
    assert isinstance(drop, Drop)
    assert drop.reason


def test_a_target_on_the_cameras_side_of_the_water_is_dropped():
    stage = calibrate(triangulator())
    air = StereoRig(rig().left, rig().right, np.eye(3), [-BASELINE, 0, 0])
    pixels = air.project([0.1, 0.0, 0.5])
    pair = {
        side: Centroid(0, 'left_camera', pixel, np.eye(2), 40.0)
        for side, pixel in zip(('left', 'right'), pixels, strict=True)
    }
    (drop,) = feed(stage, pair)
    assert isinstance(drop, Drop)


def test_the_index_is_followed_from_a_wrong_prior_and_widens_the_covariance():
    """The water's index is 1.345 and the prior says 1.333 +- 0.02."""
    exact = calibrate(triangulator())
    follower = calibrate(triangulator(**{'index.std': 0.02, 'index.calibration_std': 0.0}))
    rng = np.random.default_rng(3)
    for k in range(400):
        point = POINT + rng.uniform(-0.1, 0.1, 3) * [1, 1, 0.3]
        pair = {
            side: Centroid(
                k * 33_333_333,
                side,
                each.centre + rng.normal(0, 0.05, 2),
                each.covariance,
                each.diameter,
            )
            for side, each in centroids(point, index=1.345).items()
        }
        (without,), (with_index,) = feed(exact, pair), feed(follower, pair)
    assert abs(with_index.index.mean - 1.345) < 3 * with_index.index.std
    assert with_index.index.std < 0.01
    assert with_index.index.observed
    assert np.linalg.norm(with_index.point - point) < np.linalg.norm(without.point - point)
    assert np.trace(with_index.covariance) > np.trace(without.covariance)


def test_the_calibrations_covariance_widens_the_positions(tmp_path):
    """5 mm of doubt in the water's distance, carried to depth by finite differences."""
    path = tmp_path / 'covariance.yaml'
    path.write_text('names: [interface.distance]\ncovariance: [[2.5e-5]]\n')
    (exact,) = feed(calibrate(triangulator()), centroids(POINT))
    (doubtful,) = feed(calibrate(triangulator(calibration_covariance=str(path))), centroids(POINT))
    step = 1e-4
    moved = {'interface.distance': 0.8 + step}
    (shifted,) = feed(calibrate(triangulator(**moved)), centroids(POINT))
    by_distance = (shifted.point - exact.point) / step
    expected = exact.covariance + 2.5e-5 * np.outer(by_distance, by_distance)
    np.testing.assert_allclose(doubtful.covariance, expected, rtol=2e-2)
    np.testing.assert_array_equal(doubtful.point, exact.point)


def test_a_change_of_the_interface_takes_effect_with_the_next_pair():
    stage = calibrate(triangulator())
    (before,) = feed(stage, centroids(POINT, 1))
    stage.configure(build(TriangulatorOptions, WATER | {'interface.indices': [1.0, 1.35]}))
    (after,) = feed(stage, centroids(POINT, 2, index=1.35))
    np.testing.assert_allclose(before.point, after.point, atol=1e-9)
    assert after.index.mean == 1.35


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'method': 'paper', 'index.std': 0.01}, 'cannot follow the index'),
        ({'interface.normal': [0.0, 0.0, -1.0]}, 'behind the camera'),
        ({'left_port.normal': [0.0, 0.0, 1.0]}, 'left_port.indices is missing'),
    ],
)
def test_options_that_do_not_fit_together(values, words):
    with pytest.raises(TriangulationError, match=words):
        triangulator(**values)


def test_a_pair_of_another_size_than_the_target_is_refused_with_its_reason():
    # Seen from above, water lies at its depth over its index.
    across = FOCAL * 0.06 / (0.8 + (POINT[2] - 0.8) / 1.333)
    seen = centroids(POINT)
    for factor, taken in ((1.0, True), (1.2, True), (0.8, True), (2.0, False), (0.5, False)):
        sized = {
            side: replace(each, diameter=factor * across if side == 'right' else across)
            for side, each in seen.items()
        }
        (result,) = feed(calibrate(triangulator(**{'target.diameter': 0.06})), sized)
        assert isinstance(result, Position) == taken
        if not taken:
            assert result.reason.startswith('right: ')
            assert '0.06 m' in result.reason
        (unsized,) = feed(calibrate(triangulator()), sized)
        assert isinstance(unsized, Position)


def test_a_detector_that_tells_no_size_is_believed():
    unsized = {side: replace(each, diameter=0.0) for side, each in centroids(POINT).items()}
    (found,) = feed(calibrate(triangulator(**{'target.diameter': 0.06})), unsized)
    assert isinstance(found, Position)
