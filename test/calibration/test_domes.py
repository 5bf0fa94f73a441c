"""Domes: a rendered board whose truth is known, simulated rigs, the verdict, and the verb."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from binopos_ros.calibration.errors import CalibrationError
from binopos_ros.calibration.interface.calibrate import InterfaceCalibration, calibrate_interface
from binopos_ros.calibration.interface.guesses import DomeGuess
from binopos_ros.calibration.interface.priors import Media, guesses_from
from binopos_ros.calibration.report.files import write_interface, write_stereo
from binopos_ros.calibration.report.summary import summarise_interface
from binopos_ros.calibration.report.verdicts import DETERMINED, NOT_WORTH, verdicts
from binopos_ros.calibration.views.view import View
from binopos_ros.cli import main as binopos
from binopos_ros.optics import DomePort, PinholeCamera, StereoRig
from binopos_ros.optics.covariance_file import read_covariance
from binopos_ros.optics.rig_state import Camera, RigState
from binopos_ros.optics.uncertain_rig import UncertainRig
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions

#: Of a dome whose drawing is at hand.
EXACT = {'radius': 1e-6, 'thicknesses.0': 1e-6, 'indices.1': 1e-6, 'target_index': 1e-5}
PORTS = ('left_port', 'right_port')


@pytest.fixture(scope='module')
def corners(shared_data: Path) -> list[View]:
    """calibmar's eight views of 42 points; its upper-left pixel has its centre at (0.5, 0.5)."""
    rows = np.genfromtxt(shared_data / 'calibmar-dome/corners.csv', delimiter=',', skip_header=1)
    return [
        View(
            f'{view:.0f}',
            np.column_stack([own[:, 1:3], np.zeros(len(own))]),
            (own[:, 3:5] - 0.5,),
        )
        for view in np.unique(rows[:, 0])
        for own in [rows[rows[:, 0] == view]]
    ]


def test_a_dome_of_which_the_truth_is_known(corners: list[View]) -> None:
    """One camera; calibmar states deviations of (0.64, 0.62, 1.22) mm for these corners."""
    camera = Camera(
        np.array([1024.0, 1024.0]), np.array([1023.5, 767.5]), np.zeros(0), (2048, 1536)
    )
    guess = DomeGuess('left_port', (1.003, 1.473, 1.333), (0.007,), 0.0501, deviations=EXACT)
    found = calibrate_interface(RigState((camera,)), corners, [guess])
    dome = found.state.interfaces['left_port']
    assert isinstance(dome, DomePort)
    error = dome.centre - [0.0, 0.0, -0.030]
    deviations = np.array([found.deviation(f'left_port.centre.{i}') for i in range(3)])
    assert np.linalg.norm(error) < 0.15e-3
    assert (np.abs(error) < 2.0 * deviations).all()
    assert (deviations <= [0.12e-3, 0.12e-3, 0.22e-3]).all()


def dome_rig(centres: tuple[Any, Any]) -> StereoRig:
    """Two wide cameras behind domes."""
    lens = PinholeCamera(
        [[620.0, 0, 640], [0, 620, 480], [0, 0, 1]],
        (0.012, -0.006, 0.002, -0.0003),
        (1280, 960),
        'equidistant',
    )
    domes = (DomePort(centre, 0.05, 0.005, (1.0, 1.49, 1.333)) for centre in centres)
    return StereoRig(lens, lens, np.eye(3), [-0.12, 0.0, 0.0], None, *domes)


def calibrated(rig: StereoRig, views: list[View]) -> InterfaceCalibration:
    guesses = [
        DomeGuess(place, (1.0, 1.49, 1.333), (0.005,), 0.05, deviations=EXACT) for place in PORTS
    ]
    return calibrate_interface(replace(RigState.of(rig), interfaces={}), views, guesses)


@pytest.fixture(scope='module')
def apart(board_viewer: Any) -> tuple[StereoRig, InterfaceCalibration]:
    """A rig with one dome 5 mm off its camera and one in its place."""
    rig = dome_rig(((0.003, -0.002, 0.0035), (0.0, 0.0, 0.0)))
    rng = np.random.default_rng(11)
    views = board_viewer(rig, (0.25, 0.6), rng, tilts=(15.0, 55.0), aside=(0.8, 0.6))
    return rig, calibrated(rig, views)


def test_centres_come_out_within_what_is_stated(
    apart: tuple[StereoRig, InterfaceCalibration],
) -> None:
    rig, found = apart
    names = found.state.names
    own = [names.index(f'{place}.centre.{i}') for place in PORTS for i in range(3)]
    error = -RigState.of(rig).minus(found.state)[own]
    square = error @ np.linalg.solve(found.covariance[np.ix_(own, own)], error)
    assert square < 22.5  # one in a thousand is larger, of six degrees of freedom
    assert np.abs(error).max() < 1.5e-3


def test_the_verdict_tells_a_dome_that_matters_from_one_that_does_not(
    apart: tuple[StereoRig, InterfaceCalibration],
) -> None:
    _, found = apart
    grades = {verdict.name: verdict for verdict in verdicts(found)}
    assert grades['left_port.centre.0'].grade != NOT_WORTH
    assert grades['left_port.radius'].grade == DETERMINED
    plain = grades['right_port.centre.2']
    assert plain.grade == NOT_WORTH
    assert 'right port is not worth estimating: its centre lies' in plain.text
    assert 'positions move by' in plain.text
    text = summarise_interface(found)
    assert 'right_port.centre' in text
    assert text.count(plain.text) == 1


def test_what_is_written_is_what_the_triangulator_takes(
    apart: tuple[StereoRig, InterfaceCalibration], tmp_path: Path
) -> None:
    _, found = apart
    path, *_ = write_interface(tmp_path, found)
    block = yaml.safe_load(path.read_text())['/**/triangulator']['ros__parameters']
    flat = {f'{place}.{name}': v for place in PORTS for name, v in block[place].items()}
    _, left, right = build(TriangulatorOptions, flat).interfaces()
    for dome, place in ((left, 'left_port'), (right, 'right_port')):
        expected = found.state.interfaces[place]
        assert isinstance(dome, DomePort)
        assert isinstance(expected, DomePort)
        np.testing.assert_array_equal(dome.centre, expected.centre)
        assert dome.indices == expected.indices
    cameras = (camera.pinhole() for camera in found.state.cameras)
    pose = found.state.rotation, found.state.translation
    rig = UncertainRig(*cameras, *pose, None, left, right)
    covariance = read_covariance(tmp_path / 'covariance.yaml').ordered(rig.parameter_names)
    place = rig.parameter_names.index('left_port.centre.2')
    assert covariance[place, place] == pytest.approx(found.deviation('left_port.centre.2') ** 2)


def test_a_dome_measured_by_hand_needs_no_pictures() -> None:
    media = Media((1.0, 1.49, 1.333), (0.005,), 0.05)
    guesses = guesses_from(
        None, media, ['centre=0,0,0.003,0.0005', 'right_port.radius=0.04,0.001']
    )
    air = replace(RigState.of(dome_rig(((0, 0, 0), (0, 0, 0)))), interfaces={})
    found = calibrate_interface(air, [], guesses)
    left, right = (found.state.interfaces[place] for place in PORTS)
    assert isinstance(left, DomePort)
    assert isinstance(right, DomePort)
    np.testing.assert_array_equal(left.centre, [0.0, 0.0, 0.003])
    assert (left.radius, right.radius) == (0.05, 0.04)
    assert found.deviation('left_port.centre.1') == 0.0005
    assert found.deviation('right_port.radius') == 0.001


@pytest.mark.parametrize(
    ('media', 'priors', 'says'),
    [
        (Media((1.0, 1.333), (), 0.05), [], 'needs three indices .* and one thickness'),
        (Media((1.0, 1.49, 1.333), (0.005,), 0.0), [], 'inner radius is missing: --radius'),
        (Media((1.0, 1.49, 1.333), (0.005,), 0.05), ['distance=0.1,0.01'], "has no 'distance'"),
        (Media((1.0, 1.49, 1.333), (0.005,), 0.05), ['centre=0.1,0.01'], 'centre=X,Y,Z,SD'),
        (Media((1.0, 1.333)), ['radius=0.1,0.01'], "has no 'radius'"),
    ],
)
def test_domes_that_cannot_be_are_refused_in_one_line(
    media: Media, priors: list[str], says: str
) -> None:
    with pytest.raises(CalibrationError, match=says) as caught:
        guesses_from(None, media, priors)
    assert '\n' not in str(caught.value)


def test_without_pictures_and_without_a_centre_the_way_is_told() -> None:
    air = replace(RigState.of(dome_rig(((0, 0, 0), (0, 0, 0)))), interfaces={})
    guesses = guesses_from(None, Media((1.0, 1.49, 1.333), (0.005,), 0.05), [])
    with pytest.raises(CalibrationError, match=r'--prior centre=0,0,0\.003,0\.0005'):
        calibrate_interface(air, [], guesses)


@pytest.mark.parametrize(
    ('words', 'says'),
    [
        ('--shape dome --radius 0.05', 'add --ports'),
        ('--ports --radius 0.05', 'add --shape dome'),
        ('--ports --shape dome --indices 1,1.49,1.333 --thicknesses 0.005', '--radius 0.050'),
    ],
)
def test_the_verb_refuses_half_a_dome(
    words: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = dome_rig(((0, 0, 0), (0, 0, 0)))
    write_stereo(tmp_path, replace(RigState.of(rig), interfaces={}), np.zeros((22, 22)))
    line = f'calibrate interface --calibration {tmp_path} {words}'
    assert binopos(line.split()) == 2
    assert says in capsys.readouterr().err
