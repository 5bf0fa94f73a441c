"""config/binopos.yaml lists all parameters: complete, commented, with the defaults."""

from __future__ import annotations

import itertools

import pytest

from binopos_ros.arrivals import ArrivalOptions
from binopos_ros.bag.playback import PlayerOptions
from binopos_ros.bag.recording import RecorderOptions
from binopos_ros.capture.options import CaptureOptions
from binopos_ros.detection import DetectorOptions
from binopos_ros.node_options import Parameters
from binopos_ros.parameters import build, specs_of
from binopos_ros.platform import FixedFrameOptions
from binopos_ros.smoothing.stage import SmootherOptions, filter_options_type
from binopos_ros.triangulation.options import TriangulatorOptions
from binopos_ros.view.options import ViewerOptions

OPTIONS = {
    'camera': [CaptureOptions],
    'detector': [DetectorOptions, ArrivalOptions],
    'triangulator': [TriangulatorOptions],
    'smoother': [SmootherOptions, FixedFrameOptions, filter_options_type('cloud-kalman')],
    'player': [PlayerOptions],
    'recorder': [RecorderOptions],
    'viewer': [ViewerOptions],
}


@pytest.fixture(scope='module')
def path(project):
    return project / 'config' / 'binopos.yaml'


@pytest.mark.parametrize('node', OPTIONS)
def test_every_parameter_stands_there_with_its_default(path, node):
    specs = {}
    for options_type in OPTIONS[node]:
        specs |= specs_of(options_type)
    values = Parameters([path]).of_node(node)
    unset = {name for name, spec in specs.items() if spec.default in (None, ())}
    assert set(values) == set(specs) - unset
    for name, value in values.items():
        default = specs[name].default
        assert value == default, name


def test_parameters_without_a_default_stand_there_as_comments(path):
    text = path.read_text()
    for options_types in OPTIONS.values():
        for options_type in options_types:
            for name, spec in specs_of(options_type).items():
                if spec.default in (None, ()):
                    assert f'# {name.rpartition(".")[2]}:' in text, name


def test_every_parameter_has_a_line_of_comment(path):
    lines = path.read_text().splitlines()
    for before, line in itertools.pairwise(lines):
        name, colon, value = line.strip().partition(':')
        if colon and value and not name.startswith('#'):
            assert before.strip().startswith('#'), line


def test_the_detector_can_be_built_from_it(path):
    values = Parameters([path]).of_node('detector')
    for options_type in OPTIONS['detector']:
        own = {name: values[name] for name in specs_of(options_type)}
        assert build(options_type, own) == options_type()
