"""The layouts for Foxglove, Lichtblick and RViz name topics, fields and frames that are there."""

from __future__ import annotations

import json
import re

import pytest
import yaml

from binopos_ros.bag.definitions import jazzy
from binopos_ros.capture.options import CaptureOptions
from binopos_ros.parameters import specs_of

#: The table of topics of the README: name -> type.
ROW = re.compile(r'^\| \**`([^`]+)`(?:, `right/\.\.\.`)?\**(?: \(in[^)]*\))? \| (\w+/\w+)', re.M)
#: RViz's display -> the type that it takes.
DISPLAYS = {
    'MarkerArray': 'visualization_msgs/MarkerArray',
    'PoseWithCovariance': 'geometry_msgs/PoseWithCovarianceStamped',
    'Odometry': 'nav_msgs/Odometry',
    'Image': 'sensor_msgs/CompressedImage',
}


@pytest.fixture(scope='module')
def topics(project):
    """Full name -> type, by what the README tells."""
    found = {}
    for name, kind in ROW.findall((project / 'README.md').read_text()):
        for each in (name, name.replace('left/', 'right/')):
            found[each if each.startswith('/') else f'/stereo/{each}'] = kind
    return found


@pytest.fixture(scope='module')
def foxglove(project):
    return json.loads((project / 'config' / 'foxglove.json').read_text())


@pytest.fixture(scope='module')
def rviz(project):
    return yaml.safe_load((project / 'config' / 'binopos.rviz').read_text())


def strings(value):
    """All keys and strings in a layout."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield key
            yield from strings(each)
    elif isinstance(value, list):
        for each in value:
            yield from strings(each)
    elif isinstance(value, str):
        yield value


def frames():
    specs = specs_of(CaptureOptions)
    return {specs[f'{side}.frame_id'].default for side in ('left', 'right')}


def holds(type_name, path):
    """Whether messages of a type have the field at a path such as `pose.covariance[7]`."""
    types = jazzy().fielddefs
    package, name = type_name.split('/')
    kind = f'{package}/msg/{name}'
    for word in path.split('.'):
        field, _, index = word.partition('[')
        fields = dict(types[kind][1])
        if field not in fields:
            return False
        described = fields[field]
        if index:
            # (a fixed or free sequence, (what of, how many))
            _, (_, length) = described
            return not length or int(index.rstrip(']')) < length
        kind = described[1]
    return True


def test_foxglove_shows_only_topics_that_are_there(foxglove, topics):
    named = [each for each in strings(foxglove['configById']) if each.startswith('/')]
    assert len(named) > 10
    for each in named:
        topic, _, path = each.partition('.')
        assert topic in topics, each
        if path:
            assert holds(topics[topic], path), each


def test_foxglove_shows_every_panel_and_frames_that_are_there(foxglove):
    def panels(layout):
        return (
            [layout]
            if isinstance(layout, str)
            else [each for end in ('first', 'second') for each in panels(layout[end])]
        )

    assert sorted(panels(foxglove['layout'])) == sorted(foxglove['configById'])
    assert foxglove['configById']['3D!target']['followTf'] in frames()


def test_a_field_that_is_not_there_is_told():
    assert holds('geometry_msgs/PoseWithCovarianceStamped', 'pose.covariance[35]')
    assert not holds('geometry_msgs/PoseWithCovarianceStamped', 'pose.covariance[36]')
    assert not holds('geometry_msgs/PoseWithCovarianceStamped', 'pose.position.x')


def test_rviz_shows_topics_of_the_right_type_in_a_frame_that_is_there(rviz, topics):
    manager = rviz['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] in frames()
    shown = [each for each in manager['Displays'] if 'Topic' in each]
    assert len(shown) >= 5
    for each in shown:
        kind = each['Class'].removeprefix('rviz_default_plugins/')
        assert topics[each['Topic']['Value']] == DISPLAYS[kind], each['Name']
