"""The triangulator node, fed over topics with the correspondences of a real rig."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from sensor_msgs.msg import CameraInfo

from binopos_ros.bag.messages import position_of, stamp_of
from binopos_ros.nodes.messages import pose_message
from binopos_ros.optics.camera_info_message import read_camera_info_message
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Triangulator

pytestmark = pytest.mark.live

WIDTH, HEIGHT, PIXEL_MM = 1920, 1200, 0.00586
GLASS_INDEX, WATER_INDEX = 1.46, 1.33


class Orientation:
    """A camera of the published calibration, in metres, with OpenCV's axes."""

    def __init__(self, path: Path) -> None:
        numbers = [float(word) for word in path.read_text().split()]
        self.centre = np.array(numbers[:3]) * 1e-3
        # The file's camera looks along its own -z, with y upwards.
        self.camera_from_world = np.diag([1.0, -1.0, -1.0]) @ np.reshape(numbers[6:15], (3, 3)).T
        x0, y0, constant = numbers[15:18]
        focal = constant / PIXEL_MM
        # u = 960 + x / pixel and v = 600 - y / pixel, with the principal point at (x0, y0) mm.
        self.matrix = np.array(
            [[focal, 0, 960 + x0 / PIXEL_MM], [0, focal, 600 - y0 / PIXEL_MM], [0, 0, 1]]
        )
        self.glass = np.array(numbers[18:21]) * 1e-3


def read_pairs(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right pixels (N, 2) and the grid's points (N, 3) m of all four planes."""
    pixels: dict[int, list[np.ndarray]] = {1: [], 2: []}
    points = []
    for plane in range(1, 5):
        truth = {}
        for camera in (1, 2):
            stem = folder / 'cal' / f'plane{plane}_cam{camera}.tif'
            pixels[camera].append(np.loadtxt(f'{stem}.crd')[:, 1:])
            truth[camera] = np.loadtxt(f'{stem}.fix')
        np.testing.assert_array_equal(truth[1], truth[2])
        points.append(truth[1][:, 1:] * 1e-3)
    return np.vstack(pixels[1]), np.vstack(pixels[2]), np.vstack(points)


def camera_infos(left: Orientation, right: Orientation) -> dict[str, CameraInfo]:
    rotation = right.camera_from_world @ left.camera_from_world.T
    translation = (right.camera_from_world @ (left.centre - right.centre)).reshape(3, 1)
    none = np.zeros((5, 1))
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        left.matrix, none, right.matrix, none, (WIDTH, HEIGHT), rotation, translation
    )
    infos = {}
    for side, camera, r, p in (('left', left, r1, p1), ('right', right, r2, p2)):
        info = CameraInfo(width=WIDTH, height=HEIGHT, distortion_model='plumb_bob')
        info.d, info.k = [0.0] * 5, camera.matrix.ravel()
        info.r, info.p = r.ravel(), p.ravel()
        infos[side] = info
    return infos


def interface_in(left: Orientation) -> dict[str, object]:
    """Air, 6 mm of glass, water: seen from the left camera."""
    thickness = float(np.linalg.norm(left.glass))
    outward = left.glass / thickness
    first_surface = 2 * thickness
    return {
        'interface.normal': (left.camera_from_world @ -outward).tolist(),
        'interface.distance': float(outward @ left.centre - first_surface),
        'interface.indices': [1.0, GLASS_INDEX, WATER_INDEX],
        'interface.thicknesses': [thickness],
    }


def locate(start, peer, infos, parameters, left_px, right_px, skew=0):
    """Positions (N, 3) that the node gives for pairs over topics, the right `skew` ns later."""
    start('triangulator', parameters={'triangulator': parameters})
    pose = PoseWithCovarianceStamped
    calibrations = {side: peer.publisher(CameraInfo, f'{side}/camera_info') for side in infos}
    centroids = {side: peer.publisher(pose, f'{side}/centroid') for side in infos}
    got = peer.listen(pose, 'target/position')
    indices = peer.listen(Vector3Stamped, 'target/refractive_index')
    outputs = ('target/position', 'target/refractive_index')
    peer.connect(*calibrations.values(), *centroids.values(), inputs=outputs)
    for side, info in infos.items():
        calibrations[side].publish(info)
    for k, pair in enumerate(zip(left_px, right_px, strict=True)):
        for side, pixel in zip(('left', 'right'), pair, strict=True):
            stamp = k * 10_000_000 + (skew if side == 'right' else 0)
            message = pose_message(stamp, 'left_camera', (*pixel, 5.0), 0.04 * np.eye(2))
            centroids[side].publish(message)
        if k % 4 == 3:
            peer.wait_for(lambda k=k: len(got) > k, f'position {k}')
    peer.wait_for(lambda: len(got) == len(indices) == len(left_px), 'all positions')
    assert [stamp_of(m) for m in got] == [k * 10_000_000 for k in range(len(got))]
    return np.array([position_of(m) for m in got]), got, indices


@pytest.mark.parametrize(
    ('method', 'at_most_mm', 'at_least_mm'), [('refractive', 0.71, 0.6), ('straight', 6.2, 6.0)]
)
def test_a_real_rig_through_glass_and_water(
    start, peer, shared_data, method, at_most_mm, at_least_mm
):
    folder = shared_data / 'openptv-multiplane'
    left, right = (Orientation(folder / 'cal' / f'cam{c}.tif.ori') for c in (1, 2))
    left_px, right_px, points = read_pairs(folder)
    parameters = {**interface_in(left), 'method': method, 'epipolar_gate': 0.0}
    found, messages, indices = locate(
        start, peer, camera_infos(left, right), parameters, left_px, right_px
    )
    expected = (points - left.centre) @ left.camera_from_world.T
    rms_mm = 1e3 * np.sqrt(((found - expected) ** 2).sum(axis=1).mean())
    print(f'{method}: 3-D RMS {rms_mm:.3f} mm over {len(found)} pairs')
    assert at_least_mm <= rms_mm <= at_most_mm
    assert messages[0].header.frame_id == 'left_camera'
    if method == 'refractive':
        assert indices[0].vector.x == WATER_INDEX


def test_free_running_cameras_give_live_what_the_stage_gives_offline(start, peer, shared_data):
    """The right images 3 ms after the left ones, of a target that moves along a row of dots."""
    folder = shared_data / 'openptv-multiplane'
    left, right = (Orientation(folder / 'cal' / f'cam{c}.tif.ori') for c in (1, 2))
    left_px, right_px, _ = (part[:20] for part in read_pairs(folder))
    infos = camera_infos(left, right)
    parameters = {**interface_in(left), 'epipolar_gate': 0.0, 'pair_tolerance': 0.004}
    stage = Triangulator(build(TriangulatorOptions, parameters))
    for side, info in infos.items():
        stage.set_camera(side, read_camera_info_message(info, side))
    offline = []
    for k, pair in enumerate(zip(left_px, right_px, strict=True)):
        for side, pixel, late in zip(('left', 'right'), pair, (0, 3_000_000), strict=True):
            stamp = k * 10_000_000 + late
            centroid = Centroid(stamp, 'left_camera', pixel, 0.04 * np.eye(2), 5.0)
            offline += stage.add(side, centroid)
    live, _, _ = locate(start, peer, infos, parameters, left_px, right_px, skew=3_000_000)
    expected = np.array([position.point for position in offline])
    np.testing.assert_allclose(live, expected, rtol=0, atol=1e-9)
    together = Triangulator(build(TriangulatorOptions, parameters | {'triggered': True}))
    for side, info in infos.items():
        together.set_camera(side, read_camera_info_message(info, side))
    last = [
        found
        for side, pixel, late in zip(
            ('left', 'right'), (left_px[-1], right_px[-1]), (0, 3_000_000), strict=True
        )
        for found in together.add(side, Centroid(late, '', pixel, 0.04 * np.eye(2), 5.0))
    ]
    assert np.linalg.norm(last[0].point - expected[-1]) > 1e-4
