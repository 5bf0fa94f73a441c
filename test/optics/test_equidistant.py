"""The equidistant lens against OpenCV's fisheye module, and against itself backwards."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from binopos_ros.optics import (
    CameraInfo,
    OpticsError,
    PinholeCamera,
    StereoRig,
    read_camera_info,
    stereo_from_camera_infos,
    write_camera_info,
)
from binopos_ros.optics.rig_files import camera_infos_from_stereo
from binopos_ros.optics.rig_projection import project
from binopos_ros.optics.rig_state import RIGHT, RigState

MATRIX = np.array([[404.1, 0.0, 671.0], [0.0, 404.6, 497.5], [0.0, 0.0, 1.0]])
SIZE = (1280, 960)
LENSES = {
    'as it is named': (0.0, 0.0, 0.0, 0.0),
    'a real one': (0.1757, -0.0318, 0.0004, -0.0007),
    'narrowing': (-0.02, 0.005, -0.001, 0.0001),
    'folding within 90 degrees': (-0.2, -0.1, 0.0, 0.0),
}


@pytest.fixture(params=LENSES)
def camera(request: pytest.FixtureRequest) -> PinholeCamera:
    return PinholeCamera(MATRIX, LENSES[request.param], SIZE, 'equidistant')


def rays(widest: float = 89.999) -> np.ndarray:
    """Unit rays (N, 3) from the axis to the widest angle, degrees, all around."""
    off, around = np.meshgrid(
        np.deg2rad(np.r_[0.0, 1e-9, 1e-4, np.linspace(1.0, widest, 40)]), np.linspace(0, 6.2, 23)
    )
    across = np.sin(off)
    return np.stack(
        [across * np.cos(around), across * np.sin(around), np.cos(off)], axis=-1
    ).reshape(-1, 3)


def widest(camera: PinholeCamera) -> float:
    """Degrees off the axis to which the lens sees."""
    return float(np.degrees(np.arctan(np.sqrt(camera.lens.fold_radius_squared))))


def test_projection_is_opencvs(camera: PinholeCamera) -> None:
    points = rays(min(widest(camera) - 0.001, 89.999))
    expected = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), MATRIX, camera.distortion
    )[0][:, 0]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-10)


def test_unproject_inverts_project_to_rounding_over_the_whole_field(camera: PinholeCamera) -> None:
    u, v = np.meshgrid(np.linspace(-40, 1320, 69), np.linspace(-40, 1000, 53))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    sight = camera.unproject(pixels)
    seen = np.isfinite(sight).all(axis=1)
    np.testing.assert_allclose(camera.project(sight[seen]), pixels[seen], atol=2e-12)
    # What has no ray lies beyond the image of the widest one.
    image = camera.project(rays(min(widest(camera), 90.0) - 1e-6)) - MATRIX[:2, 2]
    reach = np.linalg.norm(image, axis=1).max()
    assert (np.linalg.norm(pixels[~seen] - MATRIX[:2, 2], axis=1) > reach - 1.0).all()
    assert seen.any()


def test_a_ray_comes_back_from_its_pixel(camera: PinholeCamera) -> None:
    sight = rays(min(0.98 * widest(camera), 89.999))
    np.testing.assert_allclose(camera.unproject(camera.project(sight)), sight, atol=1e-12)


def test_jacobian_agrees_with_differences(camera: PinholeCamera) -> None:
    x, y = np.random.default_rng(2).uniform(-0.9, 0.9, (2, 200))
    x[0] = y[0] = 0.0
    h = 1e-6
    _, _, *analytic = camera.pixels_with_jacobian(x, y)
    across = np.subtract(camera.pixels(x + h, y), camera.pixels(x - h, y)) / (2 * h)
    down = np.subtract(camera.pixels(x, y + h), camera.pixels(x, y - h)) / (2 * h)
    for got, expected in zip(analytic, (across[0], down[0], across[1], down[1]), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)


def test_what_lies_beyond_90_degrees_is_refused_by_name() -> None:
    camera = PinholeCamera(MATRIX, LENSES['a real one'], SIZE, 'equidistant')
    rig = StereoRig(camera, camera, np.eye(3), [-0.1, 0.0, 0.0])
    point = np.array([[0.5, 0.0, -0.01]])
    assert np.isnan(camera.project(point)).all()
    assert rig.explain(point) == ['left: 90 degrees or more off the axis']
    assert np.isnan(camera.unproject([-5000.0, 0.0])).all()


def test_one_point_is_seen_as_many_are(camera: PinholeCamera) -> None:
    """The floats of a live pair give the digits of the arrays."""
    rig = StereoRig(camera, camera, np.eye(3), [-0.1, 0.0, 0.0])
    points = rays(80.0)[:40] + np.array([0.05, 0.0, 0.0])
    many = np.stack(rig.project(points))
    one = np.stack([np.stack(rig.project(point)) for point in points], axis=1)
    np.testing.assert_allclose(one, many, rtol=1e-14)


@pytest.mark.parametrize('name', ['equidistant', 'fisheye'])
def test_files_and_messages_name_it(tmp_path: Path, name: str) -> None:
    """What is written as equidistant reads back; files that say fisheye mean the same."""
    left = PinholeCamera(MATRIX, LENSES['a real one'], SIZE, 'equidistant')
    turn = np.asarray(cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))[0])
    shift = np.array([-0.12, 0.001, 0.002])
    infos = camera_infos_from_stereo(left, left, turn, shift)
    read = []
    for info in infos:
        assert info.distortion_model == 'equidistant'
        path = tmp_path / f'{info.name}.yaml'
        write_camera_info(path, CameraInfo(**{**vars(info), 'distortion_model': name}))
        read.append(read_camera_info(path))
    first, second, rotation, translation = stereo_from_camera_infos(*read)
    for camera in (first, second):
        assert camera.model == 'equidistant'
        np.testing.assert_array_equal(camera.distortion, left.distortion)
    np.testing.assert_allclose(rotation, turn, atol=1e-12)
    np.testing.assert_allclose(translation, shift, atol=1e-12)


def test_the_adjustments_derivatives_agree_with_differences(camera: PinholeCamera) -> None:
    state = RigState.of(StereoRig(camera, camera, np.eye(3), [-0.1, 0.0, 0.0]))
    assert state.names[4:8] == ('left.k1', 'left.k2', 'left.k3', 'left.k4')
    points = np.random.default_rng(5).uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 1.5], (20, 3))
    found = project(state, RIGHT, points)
    for i in range(len(state.names)):
        step = np.zeros(len(state.names))
        step[i] = 1e-6
        ahead, back = (project(state.plus(s * step), RIGHT, points).pixels for s in (1, -1))
        np.testing.assert_allclose(found.by_rig[:, :, i], (ahead - back) / 2e-6, atol=1e-4)


@pytest.mark.parametrize(
    ('terms', 'model', 'says'),
    [
        (np.zeros(5), 'equidistant', '4 terms .* not 5'),
        ([0, 0, 0, np.nan], 'equidistant', 'not finite'),
        ((), 'mercator', "no lens 'mercator': choose from brown, equidistant"),
    ],
)
def test_impossible_lenses_are_refused_in_one_line(
    terms: np.ndarray, model: str, says: str
) -> None:
    with pytest.raises(OpticsError, match=says) as caught:
        PinholeCamera(MATRIX, terms, SIZE, model)
    assert '\n' not in str(caught.value)
