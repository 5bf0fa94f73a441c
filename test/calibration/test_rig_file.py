"""From a calibration to `run` and to Python: one file, one folder."""

from __future__ import annotations

import numpy as np
import pytest

from binopos_ros import calibration
from binopos_ros.calibration.report.files import write_stereo
from binopos_ros.cli.rig_file import next_step, write_rig
from binopos_ros.node_options import Parameters
from binopos_ros.optics import (
    DomePort,
    FlatInterface,
    OpticsError,
    PinholeCamera,
    StereoRig,
    read_camera_info,
)
from binopos_ros.optics.rig_files import interface_block
from binopos_ros.optics.rig_state import RigState
from binopos_ros.parameters import build
from binopos_ros.triangulation.options import TriangulatorOptions

LEFT = PinholeCamera([[900, 0, 640], [0, 905, 480], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0], (1280, 960))
RIGHT = PinholeCamera(
    [[910, 0, 630], [0, 908, 490], [0, 0, 1]], [-0.1, 0, 1e-3, 0, 0], (1280, 960)
)
TRANSLATION = [-0.23, 0.002, 0.01]
POINTS = np.array([[0.1, 0.0, 1.2], [-0.2, 0.1, 1.5]])
SURFACES = {
    'air': {},
    'water': {'interface': FlatInterface([0, 0.02, 1], 0.8, [1.0, 1.46, 1.333], [0.006])},
    'panes': {
        f'{side}_port': FlatInterface([0, 0, 1], 0.02, [1.0, 1.52, 1.333], [0.004])
        for side in ('left', 'right')
    },
    'domes': {
        f'{side}_port': DomePort([0, 0, 0.002], 0.05, 0.006, [1.0, 1.52, 1.333])
        for side in ('left', 'right')
    },
}


@pytest.fixture(params=SURFACES)
def written(request, tmp_path):
    """A rig, and the folder that a calibration leaves of it."""
    rig = StereoRig(LEFT, RIGHT, np.eye(3), TRANSLATION, **SURFACES[request.param])
    state = RigState.of(rig)
    write_stereo(tmp_path, state, 1e-8 * np.eye(len(state.names)))
    return rig, tmp_path


def triangulator(rig):
    lines = ['/**/triangulator:', '  ros__parameters:']
    lines.append('    calibration_covariance: covariance.yaml')
    for place in ('interface', 'left_port', 'right_port'):
        if (surface := getattr(rig, place)) is not None:
            lines += interface_block(place, surface)
    return '\n'.join(lines) + '\n'


def test_a_rig_is_loaded_from_the_folder_of_its_calibration(written):
    rig, folder = written
    (folder / 'interface.yaml').write_text(triangulator(rig))
    loaded = StereoRig.load(folder)
    for ours, theirs in zip(loaded.project(POINTS), rig.project(POINTS), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    for shown in ('StereoRig(baseline=0.2302 m', *(repr(each) for each in (loaded.left,))):
        assert shown in repr(loaded)


@pytest.mark.parametrize('written', ['water', 'panes', 'domes'], indirect=True)
def test_the_rig_file_is_all_that_the_nodes_need(written):
    rig, folder = written
    infos = {side: read_camera_info(folder / f'{side}.yaml') for side in ('left', 'right')}
    path, missing = write_rig(folder, triangulator(rig), infos, frozenset({'right'}), 0.04)
    assert missing == ['left.device']
    assert next_step(path, []) == f'binopos run --config {path}'
    parameters = Parameters([path])
    for node in ('camera', 'detector', 'triangulator', 'smoother'):
        parameters.check(node)
    camera = parameters.of_node('camera')
    assert camera['right.device'] == 'right'
    assert camera['left.camera_info_url'] == str(folder / 'left.yaml')
    values = parameters.of_node('triangulator')
    assert values['calibration_covariance'] == str(folder / 'covariance.yaml')
    assert values['target.diameter'] == 0.04
    given = build(TriangulatorOptions, values).interfaces()
    assert list(map(repr, given)) == [
        repr(each) for each in (rig.interface, rig.left_port, rig.right_port)
    ]
    assert repr(StereoRig.load(folder)) == repr(StereoRig.load(str(folder)))


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('/**/triangulator: {ros__parameters: {interface: {indices: [1.0, 1.333]}}}', "'normal'"),
        ('/**/triangulator: [', 'rig.yaml'),
        ('triangulator: {ros__parameters: {left_port: {shape: dome, indices: [1.0]}}}', 'thick'),
    ],
)
def test_a_folder_that_cannot_be_used_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(OpticsError, match=r'left\.yaml is not there'):
        StereoRig.load(tmp_path)
    state = RigState.of(StereoRig(LEFT, RIGHT, np.eye(3), TRANSLATION))
    write_stereo(tmp_path, state, np.eye(len(state.names)))
    (tmp_path / 'rig.yaml').write_text(text)
    with pytest.raises(OpticsError) as refused:
        StereoRig.load(tmp_path)
    assert said in str(refused.value)
    assert '\n' not in str(refused.value)


def test_the_public_names_of_the_calibration_are_there():
    for name in dir(calibration):
        assert getattr(calibration, name).__name__ == name
