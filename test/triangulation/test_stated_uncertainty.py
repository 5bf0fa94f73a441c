"""A rig's own uncertainty, on by default: as large as the errors of rigs measured by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from binopos_ros.optics import DomePort, FlatInterface, OpticsError, PinholeCamera, StereoRig
from binopos_ros.optics.covariance_file import write_covariance
from binopos_ros.optics.rig_files import camera_infos_from_stereo
from binopos_ros.optics.rig_state import RigState
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.triangulation.options import USUAL_BASELINE, TriangulatorOptions
from binopos_ros.triangulation.stage import Centroid, Position, Triangulator
from binopos_ros.triangulation.surface_options import (
    USUAL_CENTRE,
    USUAL_DISTANCE,
    USUAL_NORMAL,
    InterfaceOptions,
    PortOptions,
)
from binopos_ros.triangulation.triangulate import triangulate

CAMERA = PinholeCamera(
    [[900.0, 0.0, 639.5], [0.0, 900.0, 479.5], [0.0, 0.0, 1.0]],
    [-0.1, 0.05, 0.001, -0.001, 0.01],
    (1280, 960),
)
INFOS = camera_infos_from_stereo(CAMERA, CAMERA, np.eye(3), [-0.23, 0.0, 0.0])
PORT = PortOptions((0.0, 0.0, 1.0), 0.05, (1.0, 1.49, 1.333), (0.01,))
DOME = PortOptions(
    shape='dome',
    centre=(0.0, 0.0, 0.0),
    radius=0.05,
    indices=(1.0, 1.49, 1.333),
    thicknesses=(0.01,),
)
SURFACE = InterfaceOptions((0.03, 0.06, 1.0), 0.8, (1.0, 1.333))
RIGS = {
    'surface': TriangulatorOptions(interface=SURFACE, medium='still'),
    'ports': TriangulatorOptions(left_port=PORT, right_port=PORT),
    'domes': TriangulatorOptions(left_port=DOME, right_port=DOME),
}
NOISE = 0.01  # px^2


def located(options: TriangulatorOptions, pixels: tuple[np.ndarray, np.ndarray]) -> Position:
    """What the stage makes of one pair."""
    stage = Triangulator(options)
    results = []
    for side, info, pixel in zip(('left', 'right'), INFOS, pixels, strict=True):
        stage.set_camera(side, info)
        results += stage.add(side, Centroid(10**9, 'left', pixel, NOISE * np.eye(2), 30.0))
    (result,) = results
    assert isinstance(result, Position), result
    return result


def rig_of(options: TriangulatorOptions) -> StereoRig:
    return StereoRig(CAMERA, CAMERA, np.eye(3), [-0.23, 0.0, 0.0], *options.interfaces())


def drawn(rig: StereoRig, rng: np.random.Generator) -> StereoRig:
    """A rig whose surfaces and baseline are off by what the defaults say."""

    def off(surface: Any) -> Any:
        if surface is None:
            return None
        if isinstance(surface, DomePort):
            centre = surface.centre + USUAL_CENTRE * rng.standard_normal(3)
            return DomePort(centre, surface.radius, surface.thicknesses[0], surface.indices)
        tilt = USUAL_NORMAL * rng.standard_normal(2)
        distance = surface.distance + USUAL_DISTANCE * rng.standard_normal()
        return FlatInterface(surface.tilted(*tilt), distance, surface.indices, surface.thicknesses)

    scale = 1.0 + USUAL_BASELINE * rng.standard_normal()
    surfaces = map(off, (rig.interface, rig.left_port, rig.right_port))
    return StereoRig(CAMERA, CAMERA, np.eye(3), scale * rig.translation, *surfaces)


@pytest.mark.parametrize('kind', RIGS)
def test_positions_of_rigs_measured_by_hand_know_their_errors(kind: str) -> None:
    options = replace(RIGS[kind], epipolar_gate=0.0)
    rng = np.random.default_rng(3)
    squares, apart = [], []
    for _ in range(60):
        point = rng.uniform([-0.1, -0.1, 1.0], [0.3, 0.1, 1.2])
        place = located(options, drawn(rig_of(options), rng).project(point))
        error = place.point - point
        squares.append(error @ np.linalg.solve(place.covariance, error) / 3.0)
        assert place.systematic is not None
        apart.append(np.trace(place.noise) / np.trace(place.covariance))
    assert 0.5 < np.mean(squares) < 2.0
    # None of it enters a filter's gain: the noise alone does.
    assert np.max(apart) < 0.2


@pytest.mark.parametrize('kind', RIGS)
def test_zero_says_exact(kind: str) -> None:
    exact = {'normal_std': 0.0, 'distance_std': 0.0}
    in_port = {**exact, 'centre_std': 0.0}
    options = RIGS[kind]
    options = replace(
        options,
        baseline_std=0.0,
        interface=replace(options.interface, **exact),
        left_port=replace(options.left_port, **in_port),
        right_port=replace(options.right_port, **in_port),
    )
    place = located(options, rig_of(options).project(np.array([0.1, 0.0, 1.1])))
    assert place.systematic is None
    stage = Triangulator(options)
    for side, info in zip(('left', 'right'), INFOS, strict=True):
        stage.set_camera(side, info)
    assert not stage.caution


def test_defaults_are_told_and_what_was_said_is_not() -> None:
    def told(options: TriangulatorOptions) -> str:
        stage = Triangulator(options)
        for side, info in zip(('left', 'right'), INFOS, strict=True):
            stage.set_camera(side, info)
        return stage.caution

    options = RIGS['surface']
    assert 'interface.normal_std, interface.distance_std, baseline_std' in told(options)
    measured = replace(options.interface, normal_std=0.01, distance_std=0.001)
    said = replace(options, interface=measured, baseline_std=0.001)
    assert told(said) == ''
    assert told(replace(options, method='straight')) == ''
    # Who states what the default is knows it.
    usual = replace(options.interface, normal_std=USUAL_NORMAL, distance_std=USUAL_DISTANCE)
    assert told(replace(options, interface=usual, baseline_std=USUAL_BASELINE)) == ''
    assert 'the defaults of baseline_std:' in told(replace(options, interface=usual))


def test_the_calibrations_own_covariance_goes_before_the_defaults(tmp_path: Path) -> None:
    """What is calibrated is taken from the file, what is not from the options."""
    options = RIGS['surface']
    rig = rig_of(options)
    state = RigState.of(rig)
    deviations = {'interface.normal.0': 1e-3, 'interface.distance': 1e-3, 'translation.x': 1e-4}
    covariance = np.diag([deviations.get(name, 0.0) ** 2 for name in state.names])
    write_covariance(tmp_path / 'covariance.yaml', state, covariance)
    calibrated = replace(options, calibration_covariance=str(tmp_path / 'covariance.yaml'))
    pixels = rig.project(np.array([0.1, 0.0, 1.1]))
    place = located(calibrated, pixels)
    # Against the analytic sandwich of the whole calibration, in one go.
    whole = UncertainRig(CAMERA, CAMERA, np.eye(3), rig.translation, rig.interface)
    named = np.diag([deviations.get(name, 0.0) ** 2 for name in whole.parameter_names])
    views = (*pixels, NOISE * np.eye(2), NOISE * np.eye(2))
    expected = triangulate(whole, *views, parameter_covariance=named).covariances
    np.testing.assert_allclose(place.covariance, expected, rtol=1e-3)
    stereo_only = RigState(state.cameras, state.rotation, state.translation)
    write_covariance(tmp_path / 'covariance.yaml', stereo_only, np.zeros((24, 24)))
    by_hand = located(calibrated, pixels)
    assert np.trace(by_hand.covariance) > 5.0 * np.trace(place.covariance)
    with pytest.raises(OpticsError, match='cannot read the covariance'):
        Triangulator(replace(options, calibration_covariance=str(tmp_path / 'absent.yaml')))
