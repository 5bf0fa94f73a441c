"""Errors that all pairs share do not average out: surface, calibration, known floor."""

from __future__ import annotations

import math

import numpy as np
import pytest

from binopos_ros.optics import FlatInterface, PinholeCamera, StereoRig
from binopos_ros.triangulation.depth_aid import KnownPlane
from binopos_ros.triangulation.index import IndexEstimator
from index_settings import PIXEL_STD, SETTINGS, flat, images, path, rig_through, run


def test_a_known_floor_shows_the_index_where_the_rays_do_not():
    rig, random = rig_through(flat((0, 0, 1), 0.8, 1, 1.355)), np.random.default_rng(16)
    squares, stds = [], []
    for _ in range(100):
        truth, error = random.normal(1.355, 0.015), random.normal(0.0, 1e-3)
        points = np.column_stack(
            [np.full(25, 0.115), random.uniform(-0.2, 0.2, 25), np.full(25, 1.29)]
        )
        pixels = images(rig.with_target_index(truth), points)
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        plane = KnownPlane.at_depth(rig.interface, 0.49 + error, 1e-3)
        states = run(IndexEstimator(1.355, 0.015, known_plane=plane), rig, pixels)
        assert states[-1].observed
        squares.append(((states[-1].mean - truth) / states[-1].std) ** 2)
        stds.append(states[-1].std)
        miss = states[-1].point - points[-1]
        assert abs(miss[2]) < 4.5e-3
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 100))
    # A millimetre of the floor is 0.0027 of the index, however many pairs there are.
    assert min(stds) > 0.0026
    assert max(stds) < 0.0035


def test_errors_of_the_surface_bound_what_any_number_of_pairs_can_tell():
    setting, random = SETTINGS['tank wall'], np.random.default_rng(17)
    rig = setting.rig
    std = {'interface.distance': 1e-3, 'interface.normal.0': 1e-3, 'interface.normal.1': 1e-3}
    covariance = np.diag([std.get(name, 0.0) ** 2 for name in rig.parameter_names])
    squares, naive, stds, misses = [], [], [], []
    for _ in range(60):
        change = np.sqrt(np.diag(covariance)) * random.standard_normal(len(covariance))
        truth = random.normal(1.355, 0.015)
        points = path(setting, 25, random)
        pixels = images(rig.perturbed(change).with_target_index(truth), points)
        pixels += PIXEL_STD * random.standard_normal(pixels.shape)
        state = run(IndexEstimator(1.355, 0.015, parameter_covariance=covariance), rig, pixels)[-1]
        squares.append(((state.mean - truth) / state.std) ** 2)
        stds.append(state.std)
        miss = state.point - points[-1]
        misses.append(miss @ np.linalg.solve(state.covariance, miss))
        blind = run(IndexEstimator(1.355, 0.015), rig, pixels)[-1]
        naive.append(((blind.mean - truth) / blind.std) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 60))
    assert np.mean(misses) == pytest.approx(3.0, abs=4 * math.sqrt(6 / 60))
    assert np.mean(naive) > 2.0
    assert min(stds) > 1e-3


def test_what_a_calibration_leaves_in_the_pixels_does_not_average_out():
    setting, random = SETTINGS['one camera ahead'], np.random.default_rng(18)
    squares, naive = [], []
    for _ in range(40):
        truth = random.normal(1.355, 0.015)
        pixels = images(setting.rig.with_target_index(truth), path(setting, 60, random))
        pixels += random.normal(0.0, 0.2, 4) + PIXEL_STD * random.standard_normal(pixels.shape)
        state = run(IndexEstimator(1.355, 0.015, calibration_std=0.2), setting.rig, pixels)[-1]
        squares.append(((state.mean - truth) / state.std) ** 2)
        blind = run(IndexEstimator(1.355, 0.015), setting.rig, pixels)[-1]
        naive.append(((blind.mean - truth) / blind.std) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * math.sqrt(2 / 40))
    assert np.mean(naive) > 3.0


def orientation(path):
    """Camera, centre (3,) m and camera_from_world (3,3) of an OpenPTV .ori file (SOURCE.md)."""
    numbers = [float(word) for word in path.read_text().split()]
    centre, from_camera = np.array(numbers[:3]) * 1e-3, np.array(numbers[6:15]).reshape(3, 3)
    x, y, constant = numbers[15:18]
    pixel = 0.00586
    focal = constant / pixel
    matrix = [[focal, 0, 960 + x / pixel], [0, focal, 600 - y / pixel], [0, 0, 1]]
    camera = PinholeCamera(matrix, [], (1920, 1200))
    return camera, centre, np.diag([1, -1, -1]) @ from_camera.T


def test_a_real_rig_whose_epipolar_errors_are_systematic_is_not_overconfident(shared_data):
    """Air, glass, water; the published calibration leaves 0.5 px of epipolar error per plane.

    Taken for noise, these errors make an index of 1.43; considered, they leave room for water.
    """
    folder = shared_data / 'openptv-multiplane' / 'cal'
    left, left_centre, left_from_world = orientation(folder / 'cam1.tif.ori')
    right, right_centre, right_from_world = orientation(folder / 'cam2.tif.ori')
    glass = FlatInterface(
        left_from_world @ (0, 0, -1), left_centre[2] - 0.012, (1, 1.46, 1.34), (0.006,)
    )
    rig = StereoRig(
        left,
        right,
        right_from_world @ left_from_world.T,
        right_from_world @ (left_centre - right_centre),
        glass,
    )
    dots = [
        [np.loadtxt(folder / f'plane{plane}_cam{camera}.tif.crd') for camera in (1, 2)]
        for plane in (1, 2, 3, 4)
    ]
    pixels = np.vstack([np.hstack([one[:, 1:], two[:, 1:]]) for one, two in dots])
    pixels = np.random.default_rng(0).permutation(pixels)
    considered = run(IndexEstimator(1.34, 0.03, calibration_std=0.5), rig, pixels, std=0.2)[-1]
    assert abs(considered.mean - 1.333) < 3 * considered.std
    blind = run(IndexEstimator(1.34, 0.03), rig, pixels, std=0.2)[-1]
    for name, state in (('considered', considered), ('taken for noise', blind)):
        print(f'{name}: {state.mean:.3f} +- {state.std:.3f}')
    assert blind.std < considered.std
    assert abs(blind.mean - 1.333) > 3 * blind.std
